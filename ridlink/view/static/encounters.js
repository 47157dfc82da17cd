// The table of encounters: who came near whom, when, how near; click to jump.

import { arrange, choosableRow, find, mark, say } from "./dom.js";
import { clockTime, inOrder, KIND, label, metres, nearness, pairLabel, signedMetres } from "./format.js";

const MOST_ROWS = 60; // until somebody asks for more: hundreds of rows cost as much as the plan
const MOST_TOLD = 500; // the server tells no more of them

export class Encounters {
  #rows = new Map();
  #list = [];
  #sort = "t";
  #chosen = null;
  #all = false;

  // onPick(encounter) when somebody chooses one.
  constructor(onPick) {
    this.body = find("encounters");
    this.onPick = onPick;
    for (const button of document.querySelectorAll("[data-sort]")) {
      button.addEventListener("click", () => {
        this.#sort = button.dataset.sort;
        this.#show();
      });
    }
    find("more-encounters").addEventListener("click", () => {
      this.#all = true;
      this.#show();
    });
    this.#show();
  }

  get list() { return this.#list; }

  // Those of a history that has been read to its end, or as far as it has.
  replace(encounters, complete) {
    this.#list = encounters.filter((each) => Array.isArray(each.pair) && each.pair.length === 2);
    say(find("no-encounters"), complete ? "Nobody has come near anybody yet." : "Working out who comes near whom …");
    this.#show();
  }

  choose(id) {
    this.#chosen = id;
    for (const [key, row] of this.#rows) row.setAttribute("aria-selected", String(key === id));
  }

  // The next closest approach after t, or the one before; null if there is none.
  beside(t, direction) {
    const times = this.#list.filter((each) => (each.closest_t - t) * direction > 0.05);
    times.sort((a, b) => (a.closest_t - b.closest_t) * direction);
    return times[0] ?? null;
  }

  #show() {
    const sorted = [...this.#list].sort(this.#sort === "t"
      ? (a, b) => b.closest_t - a.closest_t || b.id - a.id
      : (a, b) => a.margin_m - b.margin_m);
    const rows = new Map();
    const shown = this.#all ? sorted : sorted.slice(0, MOST_ROWS);
    for (const each of shown) rows.set(each.id, this.#fill(this.#rows.get(each.id) ?? this.#row(), each));
    this.#rows = rows;
    arrange(this.body, [...rows.values()]);
    find("earlier-encounters").hidden = sorted.length < MOST_TOLD;
    find("more-encounters").hidden = shown.length === sorted.length;
    say(find("more-encounters"), `${sorted.length - shown.length} more`);
    find("no-encounters").hidden = sorted.length > 0;
    say(find("count-encounters"), `${sorted.length}${sorted.length < MOST_TOLD ? "" : "+"}`);
    for (const button of document.querySelectorAll("[data-sort]")) {
      const active = button.dataset.sort === this.#sort;
      button.closest("th").ariaSort = !active ? "none" : this.#sort === "t" ? "descending" : "ascending";
    }
  }

  #row() {
    const row = choosableRow(4, () => this.onPick(this.#list.find((each) => String(each.id) === row.dataset.id)));
    return row;
  }

  #fill(row, each) {
    const [pair, when, closest, spare] = row.cells;
    mark(row, "id", String(each.id));
    mark(row, "open", String(each.closed === null));
    row.setAttribute("aria-selected", String(each.id === this.#chosen));
    say(pair, pairLabel(each.pair, 9));
    const moved = each.moved?.length ? `; ${each.moved.map((name) => label(name, 40)).join(" and ")} manoeuvred` : "";
    const title = `${inOrder(each.pair).map((name) => label(name, 40)).join(" and ")}${each.collided ? ": collided" : ""}${moved}`;
    if (row.title !== title) row.title = title;
    say(when, clockTime(each.closest_t));
    say(closest, metres(each.closest_m));
    say(spare, each.collided ? "collided" : signedMetres(each.margin_m));
    const kind = each.collided ? "inside" : nearness(each.closest_m, each.closest_m - each.margin_m);
    mark(spare, "kind", KIND[kind]);
    return row;
  }
}
