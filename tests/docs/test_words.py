"""The script behind ``make words``."""

from pathlib import Path

from support import words

PLAIN = "Return the peers in two-way contact. Distances in metres."
PRONOUNS = "Who hears nobody may be the one that is cut off."


def test_pronouns_are_counted_where_nouns_should_stand():
    assert words.pronouns(PLAIN) == 0
    assert words.pronouns(PRONOUNS) == 4  # who, nobody, one that; and the first word


def test_all_kinds_of_texts_are_read(tmp_path: Path):
    (tmp_path / "one.py").write_text(f'"""{PRONOUNS}"""\n\n# {PRONOUNS}\nerror = "{PRONOUNS}"\nkey = "who"\n')
    (tmp_path / "two.md").write_text(f"# Who\n{PRONOUNS}\n\n```\nwho who who\n```\n\n| {PRONOUNS} | {PLAIN} |\n")
    (tmp_path / "texts.en.json").write_text('{"panel": {"lost": "' + PRONOUNS + '"}}')
    texts = list(words.prose(tmp_path))
    assert sorted(Path(each.place).name for each in texts if each.text == PRONOUNS) == [
        "one.py:1",
        "one.py:3",
        "one.py:4",
        "texts.en.json:1",
        "two.md:2",
        "two.md:8",
    ]
    whole = words.measured(texts)
    assert whole.pronouns == 24
    assert whole.words == 6 * 11 + 9


def test_sentences_are_parted_and_code_is_left_out():
    assert words.sentences("Return `who` of those. Errors are raised; nothing else. No.") == [
        "Return X of those.",
        "Errors are raised; nothing else.",
    ]
