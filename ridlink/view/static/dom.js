// Change the document only where it differs: it is slower than a comparison, and what is replaced loses focus.

export const find = (id) => document.getElementById(id);

export function say(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

export function mark(element, name, value) {
  if (element.dataset[name] !== value) element.dataset[name] = value;
}

// Give a table exactly these rows, in this order.
export function arrange(body, rows) {
  const kept = new Set(rows);
  for (const row of [...body.children]) if (!kept.has(row)) row.remove();
  rows.forEach((row, i) => {
    if (body.children[i] !== row) body.insertBefore(row, body.children[i] ?? null);
  });
}

// A row of a table that can be chosen by mouse and keyboard; the first of its cells holds text, the others numbers.
export function choosableRow(cells, onPick) {
  const row = document.createElement("tr");
  row.tabIndex = 0;
  for (let i = 0; i < cells; i += 1) {
    const cell = document.createElement("td");
    if (i) cell.className = "num";
    row.append(cell);
  }
  row.addEventListener("click", onPick);
  row.addEventListener("keydown", (event) => { if (event.key === "Enter") onPick(); });
  return row;
}
