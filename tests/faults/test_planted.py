"""The planted bugs still fit the code, and the hunt for them says truly which of them a campaign finds."""

import json
import shlex
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest

PLANTED = Path(__file__).parent / "planted"
sys.path.insert(0, str(PLANTED))

from bugs import ROOT, Bug, BugError, load_bugs  # noqa: E402
from flown import STAGES, Flights, Stage  # noqa: E402

BUGS = load_bugs()
BY_ID = {bug.id: bug for bug in BUGS}
FOUND, UNSEEN, FATAL = "fusion-order-of-arrival", "log-last-of-range-not-sent", "drawn-13"  # none says what reaches it

# In the place of `radron-sim faults`: sees the first bug from the third seed on, the control breaks an invariant of its own.
STANDIN = f"""
import json, sys
from importlib.util import find_spec
from pathlib import Path
assert Path(find_spec("radron.agent.fusion").origin).is_relative_to(Path.cwd()), "the packages flown are not those with the bug"
given = [one for one in sys.argv[1:] if one != "--first"]
options = dict(zip(given[::2], given[1::2]))
seed, out = int(options["--seed"]), Path(options["--out"])
with open(COUNT, "a") as file:
    file.write(str(seed) + "\\n")
if {BY_ID[FATAL].old!r} not in Path({BY_ID[FATAL].file!r}).read_text():
    raise SystemExit("the log is full of old entries")
broken = ["battery"] if seed % 2 == 0 else []
if {BY_ID[FOUND].old!r} not in Path({BY_ID[FOUND].file!r}).read_text() and seed >= 500_002:
    broken.append("beliefs")
out.mkdir()
if "--first" in sys.argv:
    broken = broken[:1]
violations = [dict(invariant=name, time_s=1.0, drones=[], text=name + " is broken") for name in broken]
(out / "missions.jsonl").write_text(json.dumps(dict(seed=seed, violations=violations)) + "\\n")
raise SystemExit(1 if broken else 0)
"""


def test_there_are_thirty_written_and_thirty_drawn() -> None:
    assert Counter(bug.origin for bug in BUGS) == {"written": 30, "drawn": 30}
    subjects = {"protocol", "log", "fusion", "frames", "mission", "separation", "vehicle"}
    assert {bug.subject for bug in BUGS if bug.origin == "written"} == subjects
    assert all(bug.harm for bug in BUGS if bug.origin == "written")


@pytest.mark.parametrize("bug", BUGS, ids=[bug.id for bug in BUGS])
def test_a_bug_fits_the_code_and_compiles(bug: Bug) -> None:
    changed = bug.changed((ROOT / bug.file).read_text(encoding="utf-8"))
    compile(changed, bug.file, "exec")


def test_a_text_that_is_gone_or_ambiguous_is_refused() -> None:
    bug = Bug(id="one", origin="written", subject="log", title="", file="agent/fusion/log.py", old="a = 1\n", new="")
    for text in ("b = 1\n", "a = 1\na = 1\n"):
        with pytest.raises(BugError, match=r"one: its old text occurs \d times in agent/fusion/log\.py"):
            bug.changed(text)


def test_the_hunt_stops_at_the_first_find_and_an_interrupted_one_goes_on(tmp_path: Path) -> None:
    flown, standin = tmp_path / "flown", tmp_path / "standin.py"
    standin.write_text(STANDIN.replace("COUNT", repr(str(flown))))
    first = _hunt(tmp_path, standin, FOUND, UNSEEN, FATAL)
    assert first.returncode == 1  # of two written bugs, one found is less than 85 %
    assert f"| `{FOUND}` | fusion | " in first.stdout
    assert "| beliefs | dealt | 500002 | 3 |" in first.stdout
    assert "| **not found** |  |  | 3 |" in first.stdout  # its violation of `battery` is one of the control too
    assert "| no result | dealt | 500000 | 1 |" in first.stdout
    assert "the log is full of old entries" in first.stderr
    assert "Written: 1 of 2 found (50%)" in first.stdout
    number = Counter(flown.read_text().split())  # by seed; the control flies only seeds with a violation by a bug
    assert number == {
        "500000": 6,
        "500001": 2,
        "500002": 5,
    }  # a mission ended by a violation of the control is flown again, to its end
    lines = (tmp_path / "out" / "found.jsonl").read_text().splitlines(keepends=True)
    assert {json.loads(line)["bug"] for line in lines} == {FOUND, UNSEEN, FATAL, ""}
    (tmp_path / "out" / "found.jsonl").write_text("".join(lines[:-1]) + lines[-1][:20])  # interrupted while writing
    again = _hunt(tmp_path, standin, FOUND, UNSEEN, FATAL)
    assert again.stdout == first.stdout
    assert len(flown.read_text().split()) == number.total() + 1


def test_missions_that_have_what_a_bug_needs_are_flown_first() -> None:
    bug = BY_ID["frames-compass-after-restart"]
    assert set(bug.reach) == {"estimated", "position-jump"}
    documents = {
        7: {"sightings": {}},
        8: {"fault": [{"kind": "position-jump"}]},
        9: {},
        10: {"sightings": {}, "fault": [{"kind": "position-jump"}]},
    }
    stage = Stage("some", (), 7, 4, drawn=documents.__getitem__)
    assert stage.seeds(bug) == [10, 7, 8, 9]
    assert stage.seeds(BY_ID[UNSEEN]) == [7, 8, 9, 10]


def test_what_reaches_a_bug_is_in_a_dealt_mission_or_a_live_one() -> None:
    dealt, _, live = STAGES
    for bug in BUGS:
        stage = live if bug.live else dealt
        assert not bug.reach or any(set(bug.reach) <= stage.has(seed) for seed in stage.seeds(bug)), bug.id


def test_without_a_control_there_is_no_hunt(tmp_path: Path) -> None:
    standin = tmp_path / "standin.py"
    standin.write_text("raise SystemExit('no such command')")
    hunted = _hunt(tmp_path, standin, FATAL)
    assert hunted.returncode == 2
    assert hunted.stderr == "planted: seed 500000 without any bug: no result: exit code 1: no such command\n"


def test_a_mission_that_does_not_end_is_stopped_and_told(tmp_path: Path) -> None:
    flights = Flights(longest_s=0.2)
    flown = flights.fly((sys.executable, "-c", "import time; time.sleep(600.0)"), tmp_path, "one", 1, "sources")
    assert flown is not None
    assert flown.violated == ("no end",)


def _hunt(folder: Path, standin: Path, *options: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-S", str(PLANTED / "run.py"), "--out", str(folder / "out"), "--dealt", "3", "--drawn", "0"]
    command += ["--live", "0"] if "--live" not in options else []
    command += ["--command", shlex.join((sys.executable, "-S", str(standin))), "--only", *options]
    return subprocess.run(command, capture_output=True, text=True, timeout=120.0, check=False)
