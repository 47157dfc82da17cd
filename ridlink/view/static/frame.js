// What is drawn at one instant: positions between two pictures, or flown on for a moment past the last.

import { E, FIELDS, N, VE, VN, TRUE_E, TRUE_N, ERROR, DISPLACEMENT, AIRFRAME, indexOf, links } from "./picture.js";

const GAP_S = 3.0; // pictures further apart are not joined
const FLOWN_ON_S = 1.0;
const GROWS_MS = 350;
const NOBODY = [];

export class Frame {
  t = NaN;
  count = 0;
  picture = null;
  names = [];
  values = new Float32Array(0);
  #under = undefined; // the picture of the history that it was filled from
  #grown = null;

  // Fill from the history; false if it knows nothing near t. Where it is `complete`, nothing near t is an empty sky.
  at(history, t, now, complete = false) {
    let index = history.before(t);
    this.#under = history.at(index);
    if (index < 0 && history.length && history.first - t < FLOWN_ON_S) index = 0;
    if (index < 0) return complete && this.#empty(t);
    const picture = history.at(index), later = history.at(index + 1);
    const joined = later && later.t - picture.t <= GAP_S;
    if (!joined && later && picture.count && t - picture.t > FLOWN_ON_S) return complete && this.#empty(t);
    this.t = t;
    this.picture = picture;
    this.names = picture.names;
    this.count = picture.count;
    if (this.values.length < picture.values.length) this.values = new Float32Array(picture.values.length);
    this.values.set(picture.values);
    if (joined) this.#between(picture, later, (t - picture.t) / (later.t - picture.t));
    else this.#onwards(Math.min(FLOWN_ON_S, Math.max(0, t - picture.t)));
    this.#grow(now);
    return true;
  }

  // Whether the history has another picture at t: who stands, or a sky without anybody, does not move into it.
  isOther(history, t) { return history.at(history.before(t)) !== this.#under; }

  get tightest() { return this.picture?.tightest ?? null; }
  get pairs() { return this.picture?.pairs ?? new Float32Array(0); }

  index(name) { return this.picture && name !== null ? indexOf(this.picture, name) : -1; }

  value(index, field) { return this.values[index * FIELDS + field]; }

  // From now on, rings change from what they are to what comes, within a moment.
  growFromHere(now) {
    const still = matchMedia("(prefers-reduced-motion: reduce)").matches;
    if (!this.picture || still) return;
    const rings = new Map();
    for (let i = 0; i < this.count; i += 1) {
      rings.set(this.names[i], this.values.slice(i * FIELDS + AIRFRAME, i * FIELDS + DISPLACEMENT + 1));
    }
    this.#grown = { rings, since: null, definition: this.picture.definition, asked: now };
  }

  get growing() { return this.#grown !== null; }

  #empty(t) {
    Object.assign(this, { t, picture: null, names: NOBODY, count: 0 });
    return true;
  }

  #between(picture, later, share) {
    const next = links(picture, later), own = this.values, other = later.values;
    const u = Math.min(1, Math.max(0, share));
    for (let i = 0; i < this.count; i += 1) {
      const a = i * FIELDS, b = next[i] * FIELDS;
      if (b < 0) continue;
      for (const field of [N, E, VN, VE, TRUE_N, TRUE_E]) own[a + field] += u * (other[b + field] - own[a + field]);
    }
  }

  #onwards(seconds) {
    const own = this.values;
    for (let a = 0; a < this.count * FIELDS; a += FIELDS) {
      own[a + N] += seconds * own[a + VN];
      own[a + E] += seconds * own[a + VE];
      own[a + TRUE_N] += seconds * own[a + VN];
      own[a + TRUE_E] += seconds * own[a + VE];
    }
  }

  #grow(now) {
    const grown = this.#grown;
    if (!grown) return;
    if (grown.since === null) {
      if (this.picture.definition !== grown.definition) grown.since = now;
      else if (now - grown.asked > 2000) this.#grown = null;
    }
    const share = grown.since === null ? 0 : (now - grown.since) / GROWS_MS;
    if (share >= 1) {
      this.#grown = null;
      return;
    }
    const eased = share * share * (3 - 2 * share);
    for (let i = 0; i < this.count; i += 1) {
      const was = grown.rings.get(this.names[i]);
      if (!was) continue;
      for (const field of [AIRFRAME, ERROR, DISPLACEMENT]) {
        const at = i * FIELDS + field;
        this.values[at] = was[field - AIRFRAME] + eased * (this.values[at] - was[field - AIRFRAME]);
      }
    }
  }
}
