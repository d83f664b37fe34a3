"use strict";
(() => {
  const table = document.getElementById("logs");
  const body = table.tBodies[0];
  const rows = [...body.rows];
  const text = document.getElementById("filter-text");
  const state = document.getElementById("filter-state");
  const verdict = document.getElementById("filter-verdict");
  const shown = document.getElementById("shown");
  const words = rows.map(row => row.textContent.toLowerCase());
  // the cells of a log without a result are fewer
  const key = (row, column) => row.cells[column] ? row.cells[column].dataset.key ?? row.cells[column].textContent.trim() : "";
  const names = new Intl.Collator(undefined, { numeric: true, sensitivity: "base" });

  function sort(head) {
    const column = head.cellIndex, numeric = head.dataset.kind === "number";
    const down = head.getAttribute("aria-sort") === "ascending";
    for (const other of table.tHead.rows[0].cells) other.removeAttribute("aria-sort");
    head.setAttribute("aria-sort", down ? "descending" : "ascending");
    const sign = down ? -1 : 1;
    const sorted = rows.map((row, place) => ({ row, place, key: key(row, column) }));
    sorted.sort((a, b) => {
      if ((a.key === "") !== (b.key === "")) return a.key === "" ? 1 : -1; // what has no value stays at the end
      const order = numeric ? a.key - b.key : names.compare(a.key, b.key);
      return sign * order || a.place - b.place;
    });
    body.append(...sorted.map(item => item.row));
  }

  function filter() {
    const wanted = text.value.toLowerCase().split(/\s+/).filter(Boolean);
    let count = 0;
    rows.forEach((row, place) => {
      const fits = wanted.every(word => words[place].includes(word))
        && (!state.value || row.dataset.state === state.value)
        && (!verdict.value || row.dataset.verdicts.split(" ").includes(verdict.value));
      row.hidden = !fits;
      count += fits;
    });
    shown.textContent = count === rows.length ? `${count} logs` : `${count} of ${rows.length} logs`;
  }

  for (const head of table.tHead.rows[0].cells) {
    const button = document.createElement("button");
    button.type = "button";
    button.append(...head.childNodes);
    head.append(button);
    button.addEventListener("click", () => sort(head));
  }
  for (const control of [text, state, verdict]) control.addEventListener("input", filter);
  document.getElementById("filters").hidden = false;
  filter();
})();
