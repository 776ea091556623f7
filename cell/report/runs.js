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
// Two ticked runs: how far apart their numbers are, and the command that compares all else.
const compared = document.getElementById("compared");
table.addEventListener("change", () => {
  const ticked = rows.filter((row) => row.querySelector("input:checked"));
  compared.hidden = ticked.length < 2;
  const [one, other] = ticked;
  const apart = (column) => Math.abs(parseFloat(text(one, column)) - parseFloat(text(other, column))).toFixed(1);
  const names = ticked.map((row) => row.querySelector("input").value);
  const words = ticked.length === 2 && ["edges", "d"].map((name, i) => [name, apart(i + 2)]).filter(([, size]) => size !== "NaN");
  compared.textContent = (words && words.length ? `${words.map(([name, size]) => `${name} differ by ${size} mm`).join(", ")}; ` : "")
    + `cell report ${names.join(" ")}`;
});
filter.addEventListener("input", show);
show();
