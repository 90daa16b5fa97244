// The filter box: of all tables below it, only rows that hold each of its words are shown.
for (const box of document.querySelectorAll("input.filter")) {
  const follows = (element) => box.compareDocumentPosition(element) & Node.DOCUMENT_POSITION_FOLLOWING;
  box.hidden = false; // without scripts there is no box
  box.addEventListener("input", () => {
    const words = box.value.toLowerCase().split(/\s+/);
    for (const row of [...document.querySelectorAll("tbody tr")].filter(follows))
      row.hidden = !words.every((word) => row.textContent.toLowerCase().includes(word));
  });
}
