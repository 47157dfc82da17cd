// Which instant is shown: the newest while it follows, any other while somebody plays, drags or waits.

const BEHIND_S = 0.13; // shown so much behind the newest instant, so that there is always one to fly towards
const LOST_S = 1.0;

export class Clock {
  t = 0;
  t0 = 0;
  t1 = 0;
  rate = 0; // seconds of the source for one second; 0 paused, negative backwards; while it follows: unused
  speed = 1;
  following = false;
  #now = null;
  #newest = null;
  #arrived = null;
  #pace = 1;

  constructor(onChange) {
    this.onChange = onChange;
  }

  get playing() { return this.following || this.rate !== 0; }

  extent(t0, t1) {
    if (typeof t0 === "number") this.t0 = t0;
    if (typeof t1 === "number") this.t1 = Math.max(t1, this.t0);
  }

  reset() {
    this.#newest = null;
    this.#pace = 1;
  }

  // An instant came in, just now.
  arrived(t, now) {
    if (this.#newest !== null && t < this.#newest - LOST_S) this.reset();
    if (this.#newest !== null && t > this.#newest) {
      const pace = (t - this.#newest) / Math.max(0.02, (now - this.#arrived) / 1000);
      this.#pace += 0.05 * (Math.min(30, pace) - this.#pace);
    }
    this.#newest = t;
    this.#arrived = now;
    this.t1 = Math.max(this.t1, t);
  }

  follow() {
    this.following = true;
    this.rate = 0;
    this.reset();
    this.onChange();
  }

  seek(t) {
    this.following = false;
    this.t = Math.min(this.t1, Math.max(this.t0, t));
    this.onChange();
  }

  play(direction = 1) {
    this.following = false;
    this.rate = direction * this.speed;
    if (direction > 0 && this.t >= this.t1 - 0.05) this.t = this.t0;
    this.onChange();
  }

  pause() {
    this.following = false;
    this.rate = 0;
    this.onChange();
  }

  setSpeed(speed) {
    this.speed = speed;
    if (this.rate) this.rate = Math.sign(this.rate) * speed;
    this.onChange();
  }

  // Time goes on by what has passed since the last call. `live` says whether the end of the recording runs away, `waits`
  // that what is to be shown has not come yet: then a player stands still.
  tick(now, live, waits = false) {
    const passed = this.#now === null || (waits && !this.following) ? 0 : Math.min(0.25, (now - this.#now) / 1000);
    this.#now = now;
    if (this.following) {
      this.#chase(passed);
    } else if (this.rate) {
      this.t += this.rate * passed;
      if (this.t <= this.t0) {
        this.t = this.t0;
        if (this.rate < 0) this.pause();
      } else if (this.t >= this.t1) {
        this.t = this.t1;
        if (live) this.follow();
        else this.pause();
      }
    }
    return this.t;
  }

  // Fly smoothly a little behind the newest instant, whatever the rhythm in which instants come in.
  #chase(passed) {
    if (this.#newest === null) return;
    const aim = BEHIND_S * Math.max(1, this.#pace);
    const behind = this.#newest - this.t;
    if (behind > aim + LOST_S * Math.max(1, this.#pace) || behind < -LOST_S) {
      this.t = this.#newest - aim;
      return;
    }
    const correction = Math.min(2, Math.max(0, 1 + 1.5 * (behind - aim) / Math.max(1, this.#pace)));
    this.t += passed * this.#pace * correction;
  }
}
