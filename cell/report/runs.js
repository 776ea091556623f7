const table = document.getElementById("runs"), body = table.tBodies[0];
const filter = document.getElementById("filter"), count = document.getElementById("count");
const rows = Array.from(body.rows);
const text = (row, column) => row.cells[column].textContent.replace("\u2212", "-");

function show() {
  const words = filter.value.toLowerCase().split(/\s+/).filter(Boolean);
  let shown = 0;
  for (const row of rows) {
    const content = row.textContent.toLowerCase();
    row.hidden = !words.every((word) => content.includes(word));
    shown += row.hidden ? 0 : 1;
  }
  count.textContent = `${shown} of ${rows.length}`;
}

function sort(column, down) {
  const number = (row) => parseFloat(text(row, column));
  const numeric = rows.some((row) => /^[+-]?[\d.]+(\s*(mm|s|m\/s))?$/.test(text(row, column)));
  const key = (a, b) => numeric
    ? (Number.isNaN(number(a)) - Number.isNaN(number(b))) || (number(a) - number(b)) * down
    : text(a, column).localeCompare(text(b, column)) * down;
  body.append(...rows.sort(key));
}

table.tHead.querySelectorAll("th").forEach((head, column) => {
  head.querySelector("button")?.addEventListener("click", () => {
    const down = head.ariaSort === "ascending" ? -1 : 1;
    table.tHead.querySelectorAll("th").forEach((other) => { other.ariaSort = null; });
    head.ariaSort = down === 1 ? "ascending" : "descending";
    sort(column, down);
  });
});
filter.addEventListener("input", show);
show();
