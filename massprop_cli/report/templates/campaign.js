"use strict";
(() => {
  const table = document.getElementById("logs");
  const body = table.tBodies[0];
  const rows = [...body.rows];
  const controls = {};
  for (const name of ["text", "state", "vehicle", "warning", "verdict"]) {
    const control = document.getElementById(`filter-${name}`);
    if (control) controls[name] = control;
  }
  const wants = (name, row, several) => {
    const wanted = controls[name] ? controls[name].value : "";
    return !wanted || (several ? row.dataset[several].split(" ").includes(wanted) : row.dataset[name] === wanted);
  };
  let sorted = "";
  const shown = document.getElementById("shown");
  const words = rows.map(row => row.textContent.toLowerCase());
  // the cells of a log without a result are fewer
  const key = (row, column) => row.cells[column] ? row.cells[column].dataset.key ?? row.cells[column].textContent.trim() : "";
  const names = new Intl.Collator(undefined, { numeric: true, sensitivity: "base" });

  function sort(head, down = head.getAttribute("aria-sort") === "ascending") {
    const column = head.cellIndex, numeric = head.dataset.kind === "number";
    for (const other of table.tHead.rows[0].cells) other.removeAttribute("aria-sort");
    head.setAttribute("aria-sort", down ? "descending" : "ascending");
    const sign = down ? -1 : 1;
    const keyed = rows.map((row, place) => ({ row, place, key: key(row, column) }));
    keyed.sort((a, b) => {
      if ((a.key === "") !== (b.key === "")) return a.key === "" ? 1 : -1; // what has no value stays at the end
      const order = numeric ? a.key - b.key : names.compare(a.key, b.key);
      return sign * order || a.place - b.place;
    });
    body.append(...keyed.map(item => item.row));
    sorted = `${column}${down ? "-" : "+"}`;
  }

  function filter() {
    const wanted = controls.text.value.toLowerCase().split(/\s+/).filter(Boolean);
    let count = 0;
    rows.forEach((row, place) => {
      const fits = wanted.every(word => words[place].includes(word))
        && wants("state", row) && wants("vehicle", row) && wants("warning", row, "warnings") && wants("verdict", row, "verdicts");
      row.hidden = !fits;
      count += fits;
    });
    shown.textContent = count === rows.length ? `${count} logs` : `${count} of ${rows.length} logs`;
  }

  // what is filtered and sorted stands in the address, so that it can be sent to someone
  function remember() {
    const said = new URLSearchParams();
    for (const [name, control] of Object.entries(controls)) if (control.value) said.set(name, control.value);
    if (sorted) said.set("sort", sorted);
    history.replaceState(null, "", said.size ? `#${said}` : location.href.split("#")[0]);
  }

  function recall() {
    const said = new URLSearchParams(location.hash.includes("=") ? location.hash.slice(1) : "");
    for (const [name, control] of Object.entries(controls)) if (said.has(name)) control.value = said.get(name);
    const [, column, way] = (said.get("sort") || "").match(/^(\d+)([+ -])$/) || [];
    if (column && heads[column]) sort(heads[column], way === "-");
    filter();
  }

  const heads = [...table.tHead.rows[0].cells];
  for (const head of heads) {
    const button = document.createElement("button");
    button.type = "button";
    button.append(...head.childNodes);
    head.append(button);
    button.addEventListener("click", () => { sort(head); remember(); });
  }
  for (const control of Object.values(controls)) control.addEventListener("input", () => { filter(); remember(); });
  document.getElementById("filters").hidden = false;
  recall();
})();
