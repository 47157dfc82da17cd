// Health of the link: what comes in, what was refused, who else looks.

import { find, mark, say } from "./dom.js";
import { fixed } from "./format.js";

const STATES = {
  connecting: "connecting", live: "live", recorded: "recording", ended: "ended", lost: "connection lost, trying again",
  full: "too many viewers, trying again",
};

export class LinkHealth {
  constructor() {
    this.list = find("health");
    this.dot = find("link-dot");
    this.pill = find("state");
    this.rows = new Map();
  }

  state(state) {
    say(this.pill, STATES[state]);
    mark(this.pill, "state", state === "full" ? "lost" : state);
    if (state === "lost" || state === "full") mark(this.dot, "kind", "alarm");
  }

  // Of a recording no link is heard.
  draw(health, isRecording) {
    const rejects = Object.entries(health.rejects ?? {}).filter(([, count]) => count > 0);
    const refused = rejects.reduce((sum, [, count]) => sum + count, 0);
    const heard = isRecording ? [["Source", "a recording: no link is heard"]] : [
      ["Frames", `${fixed(health.frames_per_s, 0)} a second`],
      ["Vehicles", fixed(health.vehicles, 0)],
      ["Behind", `${fixed(health.lag_ms, 0)} ms`],
    ];
    const rows = [
      ...heard,
      ["Viewers", fixed(health.clients, 0)],
      ["Not shown", fixed(health.dropped, 0)],
      ["Refused", fixed(refused, 0)],
      ...rejects.slice(0, 20).map(([cause, count]) => [cause, fixed(count, 0)]),
    ];
    const wanted = new Set(rows.map(([name]) => name));
    for (const [name, row] of this.rows) {
      if (wanted.has(name)) continue;
      row.remove();
      this.rows.delete(name);
    }
    for (const [name, value] of rows) say(this.#row(name).lastChild, value);
    mark(this.dot, "kind", health.lag_ms > 500 ? "warn" : "good");
  }

  #row(name) {
    let row = this.rows.get(name);
    if (!row) {
      row = document.createElement("div");
      const term = document.createElement("dt"), value = document.createElement("dd");
      term.textContent = name;
      row.className = "wide";
      row.append(term, value);
      this.list.append(row);
      this.rows.set(name, row);
    }
    return row;
  }
}
