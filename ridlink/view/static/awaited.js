// A history under another definition is read for a while: curve and encounters are shown at once when both are whole.

export class Awaited {
  #series = null;
  #encounters = null;

  waiting = false;

  begin() {
    this.waiting = true;
    this.#series = this.#encounters = null;
  }

  end() { this.waiting = false; }

  // A series or a list of encounters; what is to be shown now, of both kinds or none as long as one is not whole.
  take(message) {
    if (!this.waiting) return [message];
    if (message.type === "series") this.#series = message;
    else this.#encounters = message;
    if (!isWhole(this.#series) || !isWhole(this.#encounters)) return [];
    this.waiting = false;
    return [this.#series, this.#encounters];
  }
}

function isWhole(message) {
  return message !== null && message.complete !== false;
}

// How much of [t0, t1] a series covers, 0 to 1.
export function covered({ from, step_s: step, required_m: required }, t0, t1) {
  return Math.min(1, Math.max(0, (from + step * required.length - t0) / Math.max(t1 - t0, step)));
}
