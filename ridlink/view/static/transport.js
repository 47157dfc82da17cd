// Play, back, speed, live and the scrubber.

import { find, mark, say } from "./dom.js";
import { clockTime, utcTime } from "./format.js";

export const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 5, 10, 20];

export class Transport {
  constructor(clock) {
    this.clock = clock;
    this.scrubber = find("scrubber");
    this.speed = find("speed");
    for (const speed of SPEEDS) this.speed.append(new Option(`${speed}×`, String(speed), speed === 1, speed === 1));
    this.speed.addEventListener("change", () => clock.setSpeed(Number(this.speed.value)));
    this.scrubber.addEventListener("input", () => clock.seek(Number(this.scrubber.value)));
    find("play").addEventListener("click", () => this.toggle());
    find("back").addEventListener("click", () => this.backwards());
    find("start").addEventListener("click", () => clock.seek(clock.t0));
    find("live").addEventListener("click", () => clock.follow());
  }

  toggle() {
    if (this.clock.playing) this.clock.pause();
    else this.clock.play(1);
  }

  backwards() {
    if (this.clock.rate < 0) this.clock.pause();
    else this.clock.play(-1);
  }

  faster(steps) {
    const index = SPEEDS.indexOf(this.clock.speed) + steps;
    this.clock.setSpeed(SPEEDS[Math.min(SPEEDS.length - 1, Math.max(0, index))]);
  }

  // Show where the clock stands; range is the extent of the strip above the scrubber.
  draw(range, live, utc0) {
    const { clock, scrubber } = this;
    if (scrubber.min !== String(range[0])) scrubber.min = String(range[0]);
    if (scrubber.max !== String(range[1])) scrubber.max = String(range[1]);
    scrubber.value = String(clock.t);
    const time = clockTime(clock.t);
    scrubber.setAttribute("aria-valuetext", time);
    say(find("clock"), time);
    say(find("utc"), utc0 === null ? "" : utcTime(utc0 + clock.t));
    const play = find("play"), back = find("back"), follow = find("live");
    mark(play, "playing", String(clock.following || clock.rate > 0));
    play.setAttribute("aria-label", clock.playing ? "Pause" : "Play");
    back.setAttribute("aria-pressed", String(clock.rate < 0));
    follow.setAttribute("aria-pressed", String(clock.following));
    follow.hidden = !live;
    if (this.speed.value !== String(clock.speed)) this.speed.value = String(clock.speed);
  }
}
