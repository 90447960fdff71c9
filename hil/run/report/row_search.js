// Lists of cases that can be searched.
for (const list of document.querySelectorAll(".list")) {
  const input = list.querySelector("input"),
    count = input.nextElementSibling;
  const rows = [...list.querySelectorAll("tr")].slice(1).map((row) => [row, row.textContent.toLowerCase()]);
  input.hidden = rows.length < 8;
  input.oninput = () => {
    const words = input.value.toLowerCase().split(/\s+/);
    let shown = 0;
    for (const [row, text] of rows) {
      row.hidden = !words.every((word) => text.includes(word));
      shown += !row.hidden;
    }
    count.textContent = input.value ? `${shown} of ${rows.length}` : "";
  };
}
