// Where everybody came from: the last seconds before the instant shown, from the history.

import { E, FIELDS, indexOf, N } from "./picture.js";

export const TRAIL_S = 20;
export const TRAIL_STEP_S = 0.5;
const BROKEN_S = 3;

export class Trails {
  #bucket = null;
  #names = null;

  // Points of the i-th vehicle from starts[i] until starts[i + 1], oldest first: north, east, north, east, ... A new
  // object whenever they have changed.
  lines = { starts: new Int32Array(1), points: new Float32Array(0) };

  // Collected anew whenever the instant shown has moved on by a step, the history has changed, or others are in the air.
  update(history, t, changes, names) {
    const bucket = `${Math.floor(t / TRAIL_STEP_S)} ${changes}`;
    if (bucket === this.#bucket && names === this.#names) return;
    this.#bucket = bucket;
    this.#names = names;
    const pictures = unbroken(history, t);
    const places = pictures.map((picture) => (picture.names === names ? null : names.map((name) => indexOf(picture, name))));
    const starts = new Int32Array(names.length + 1), points = new Float32Array(2 * names.length * pictures.length);
    let end = 0;
    for (let i = 0; i < names.length; i += 1) {
      pictures.forEach(({ values }, k) => {
        const at = (places[k] ? places[k][i] : i) * FIELDS;
        if (at < 0) return;
        points[end] = values[at + N];
        points[end + 1] = values[at + E];
        end += 2;
      });
      starts[i + 1] = end;
    }
    this.lines = { starts, points: points.subarray(0, end) };
  }
}

// Pictures of the last seconds before t, a step apart, since the last time that there were none for a while.
function unbroken(history, t) {
  let found = [];
  for (let at = Math.floor(t / TRAIL_STEP_S) * TRAIL_STEP_S - TRAIL_S; at <= t; at += TRAIL_STEP_S) {
    const index = history.before(at);
    const picture = index >= 0 ? history.at(index) : null, last = found.at(-1);
    if (!picture || picture === last) continue;
    if (last && picture.t - last.t > BROKEN_S) found = [];
    found.push(picture);
  }
  return found.length && t - found.at(-1).t > BROKEN_S ? [] : found;
}
