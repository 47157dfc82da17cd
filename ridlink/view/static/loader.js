// Fetches the stretch of history that is looked at, and the one that is looked at next.

const PATIENCE_MS = 6000;
const SOON_MS = 1500;
const DRAGGED_PAST_MS = 150;
const MOST_INSTANTS = 300;
const MOST_ROWS = 9000; // of one request

export class Loader {
  #id = 0;
  #waiting = null;
  #lookedAt = null;
  #begunAt = null;
  #have = new Map(); // what is looked at, step, number of the stretch -> complete until

  complete = false; // whether all is there of the stretch that was last looked at

  // send(request) is false if nobody takes it.
  constructor(send) {
    this.send = send;
  }

  // What is looked at: definition and selected vehicle. What was fetched for another one does not count.
  look(definition, selected) {
    this.key = JSON.stringify([definition, selected]);
  }

  forget() {
    this.#have.clear();
    this.#waiting = null;
    this.#lookedAt = null;
    this.complete = false;
    this.#begunAt = null;
  }

  // Only [from, to] is still remembered.
  forgetBeyond(from, to) {
    for (const [key, stretch] of this.#have) {
      if (stretch.from < from || stretch.to > to) this.#have.delete(key);
    }
  }

  // Called at every frame while somebody looks at the past; `known` says that the instant of the clock is there.
  want(clock, vehicles, step, now, known = true) {
    this.#begunAt ??= now;
    if (vehicles === 0 && now - this.#begunAt < SOON_MS) {
      this.#askAt(clock.t); // its answer says how many there are, and so how much to ask for at once
      return;
    }
    const pace = Math.abs(clock.rate);
    const coarse = step * Math.max(1, Math.ceil(pace / 4));
    const instants = Math.max(30, Math.min(MOST_INSTANTS, Math.floor(MOST_ROWS / Math.max(1, vehicles))));
    const length = coarse * instants;
    const here = Math.floor(clock.t / length);
    const ahead = clock.rate < 0 ? here - 1 : here + 1;
    this.complete = this.#complete(here, length, coarse, clock);
    if (!known && !this.#waiting && this.complete) this.#askAt(clock.t);
    const trail = clock.t - here * length < length / 2 ? here - 1 : null;
    for (const number of [here, ahead, trail]) {
      if (number === null || (number !== here && number * length > clock.t1)) continue;
      if ((number + 1) * length < clock.t0) continue;
      if (this.#complete(number, length, coarse, clock)) continue;
      if (this.#busy(number === here, clock.t, length, now)) return;
      if (number === here) this.#askAt(clock.t); // sooner there than all of its stretch
      this.#ask(number, length, coarse, clock, now);
      return;
    }
  }

  get waiting() { return this.#waiting !== null; }

  // An answer, or a part of one; the stretch that is now complete, or null.
  answered(message, now) {
    const waiting = this.#waiting;
    if (!waiting) return null;
    waiting.heard = now; // be it of an earlier one, which was on its way
    if (message.id !== waiting.id || message.done === false) return null;
    this.#waiting = null;
    this.#have.set(waiting.key, waiting);
    return waiting;
  }

  #complete(number, length, step, clock) {
    const known = this.#have.get(`${this.key} ${step.toFixed(3)} ${number}`);
    if (!known) return false;
    return known.to >= (number + 1) * length - step || known.to >= clock.t1 - 1;
  }

  // Whether to wait for what was asked before.
  #busy(urgent, t, length, now) {
    const waiting = this.#waiting;
    if (!waiting) return false;
    if (now - waiting.heard > PATIENCE_MS) return false;
    const short = waiting.to - waiting.from <= 1.5 * length;
    const useful = waiting.look === this.key && t >= waiting.from && t <= waiting.to && short;
    return !(urgent && !useful && now - waiting.since > DRAGGED_PAST_MS);
  }

  // The instant at t, or the last one before: there may be none in its stretch.
  #askAt(t) {
    const looked = `${this.key} ${t.toFixed(1)}`;
    if (looked === this.#lookedAt) return;
    this.#lookedAt = looked;
    this.#id += 1;
    this.send({ at: t, id: this.#id });
  }

  #ask(number, length, step, clock, now) {
    const from = Math.max(clock.t0, number * length), to = Math.min(clock.t1, (number + 1) * length);
    this.#id += 1;
    if (!this.send({ window: [from, to], id: this.#id, step })) return;
    const key = `${this.key} ${step.toFixed(3)} ${number}`;
    this.#waiting = { id: this.#id, key, look: this.key, from, to, since: now, heard: now };
  }
}
