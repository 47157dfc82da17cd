// The table of everybody in the air. Only rows that can be seen are filled, so that hundreds cost little.

import { arrange, choosableRow, find, mark, say } from "./dom.js";
import { fixed, inOrder, label } from "./format.js";
import { AGE, ALTITUDE, DISPLACEMENT, E, N, STATUS, VE, VN } from "./picture.js";
import { kindOf } from "./traffic.js";

const ROW_PX = 28;
const STATUSES = ["flying", "stranger", "stale"];

export class Vehicles {
  #names = null;
  #selected = undefined;
  #rows = [];

  constructor(onPick) {
    this.body = find("vehicles");
    this.panel = find("panel-vehicles");
    this.onPick = onPick;
  }

  get ordered() { return this.#rows.map((row) => row.name); }

  draw(frame, selected) {
    say(find("count-vehicles"), String(frame.count));
    if (frame.names !== this.#names) this.#arrange(frame.names);
    if (this.#selected !== selected) {
      this.#selected = selected;
      for (const { row, name } of this.#rows) row.setAttribute("aria-selected", String(name === selected));
    }
    if (this.panel.hidden) return;
    mark(this.body, "shown", frame.t.toFixed(2));
    const { scrollTop, clientHeight } = this.panel;
    const first = Math.max(0, Math.floor(scrollTop / ROW_PX) - 2);
    for (const { row, name } of this.#rows.slice(first, first + Math.ceil(clientHeight / ROW_PX) + 4)) {
      this.#fill(row, frame, frame.index(name));
    }
  }

  #arrange(names) {
    this.#names = names;
    this.#selected = undefined;
    const known = new Map(this.#rows.map((each) => [each.name, each]));
    this.#rows = inOrder(names).map((name) => known.get(name) ?? { name, row: this.#row(name) });
    arrange(this.body, this.#rows.map((each) => each.row));
  }

  #row(name) {
    const row = choosableRow(5, () => this.onPick(name));
    row.dataset.name = name;
    row.title = label(name, 80);
    say(row.cells[0], label(name, 20));
    return row;
  }

  #fill(row, frame, index) {
    if (index < 0) return;
    const of = (field) => frame.value(index, field);
    say(row.cells[1], fixed(Math.hypot(of(VN), of(VE)), 1));
    say(row.cells[2], fixed(of(ALTITUDE), 0));
    say(row.cells[3], fixed(of(DISPLACEMENT), 1));
    say(row.cells[4], fixed(of(AGE), 1));
    mark(row, "north", of(N).toFixed(1));
    mark(row, "east", of(E).toFixed(1));
    mark(row, "status", STATUSES[kindOf(of(STATUS))]);
  }
}
