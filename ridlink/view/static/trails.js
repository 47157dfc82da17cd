// Where everybody came from: the last seconds before the instant shown, from the history.

import { E, FIELDS, N } from "./picture.js";

export const TRAIL_S = 20;
export const TRAIL_STEP_S = 0.5;
const BROKEN_S = 3;

export class Trails {
  #points = new Map();
  #bucket = null;

  // Points of a name, oldest first: north, east, north, east, ...
  of(name) { return this.#points.get(name); }

  forget() { this.#bucket = null; }

  // Collected anew whenever the instant shown has moved on by a step, or the history has changed.
  update(history, t, changes) {
    const bucket = `${Math.floor(t / TRAIL_STEP_S)} ${changes}`;
    if (bucket === this.#bucket) return;
    this.#bucket = bucket;
    this.#points.clear();
    let last = null;
    for (let at = Math.floor(t / TRAIL_STEP_S) * TRAIL_STEP_S - TRAIL_S; at <= t; at += TRAIL_STEP_S) {
      const index = history.before(at);
      const picture = index >= 0 ? history.at(index) : null;
      if (!picture || picture === last) continue;
      if (last && picture.t - last.t > BROKEN_S) this.#points.clear();
      last = picture;
      for (let i = 0; i < picture.count; i += 1) {
        const points = this.#points.get(picture.names[i]);
        const north = picture.values[i * FIELDS + N], east = picture.values[i * FIELDS + E];
        if (points) points.push(north, east);
        else this.#points.set(picture.names[i], [north, east]);
      }
    }
    if (last && t - last.t > BROKEN_S) this.#points.clear();
  }
}
