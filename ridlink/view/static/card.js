// The selected vehicle: its velocity space and its figures.

import { find, mark, say } from "./dom.js";
import { fixed, label, metres, UNKNOWN } from "./format.js";
import { drawInset } from "./inset.js";
import {
  AGE, AIRFRAME, ALTITUDE, DISPLACEMENT, E, ERROR, N, STALE, STATUS, STRANGER, TRUE_E, TRUE_N, VE, VN,
} from "./picture.js";
import { kindOf } from "./traffic.js";

const WORDS = { [STRANGER]: ["does not say that it avoids", "warn"], [STALE]: ["not heard", "stale"] };

export class Card {
  constructor(palette) {
    this.palette = palette;
    this.inset = find("inset");
    this.shown = [];
    this.size = { width: 0, height: 0 }; // observed: whoever asks the canvas, between changes, has the page laid out anew
    new ResizeObserver(([{ contentRect: { width, height } }]) => {
      this.size = { width, height };
    }).observe(this.inset);
  }

  draw(frame, selected) {
    const index = frame.index(selected);
    say(find("vehicle-name"), selected === null ? "No vehicle selected" : label(selected, 32));
    find("vehicle-hint").hidden = index >= 0;
    find("vehicle-body").hidden = index < 0;
    if (index < 0) {
      find("vehicle-status").hidden = true;
      say(find("vehicle-hint"), selected === null
        ? "Click a vehicle on the plan, or choose one from the list." : "Not in the air at this instant.");
      return;
    }
    const of = (field) => frame.value(index, field);
    const space = frame.picture.selected?.name === selected ? frame.picture.selected : null;
    for (const part of ["preferred", "chosen", "reachable"]) find(`key-${part}`).hidden = !space?.[part];
    const shown = [space, of(VN), of(VE), this.size, this.palette.ground];
    if (shown.some((each, i) => each !== this.shown[i])) {
      drawInset(this.inset, this.size, space, [of(VN), of(VE)], this.palette);
      this.shown = shown;
    }
    this.#figures(of);
  }

  #figures(of) {
    const words = WORDS[kindOf(of(STATUS))], tag = find("vehicle-status");
    tag.hidden = !words;
    if (words) {
      say(tag, words[0]);
      mark(tag, "kind", words[1]);
    }
    const speed = Math.hypot(of(VN), of(VE));
    const course = (Math.atan2(of(VE), of(VN)) * 180 / Math.PI + 360) % 360;
    say(find("fact-speed"), `${fixed(speed, 1)} m/s`);
    say(find("fact-course"), speed > 0.5 ? `${String(Math.round(course) % 360).padStart(3, "0")}°` : UNKNOWN);
    say(find("fact-altitude"), metres(of(ALTITUDE)));
    say(find("fact-age"), Number.isFinite(of(AGE)) ? `${fixed(of(AGE), 1)} s ago` : UNKNOWN);
    const [airframe, error, outer] = [of(AIRFRAME), of(ERROR), of(DISPLACEMENT)];
    say(find("fact-rings"),
      `${fixed(airframe, 1)} + ${fixed(error - airframe, 1)} + ${fixed(outer - error, 1)} = ${metres(outer)}`);
    const off = Math.hypot(of(TRUE_N) - of(N), of(TRUE_E) - of(E));
    find("fact-off-row").hidden = !Number.isFinite(off);
    say(find("fact-off"), `${metres(off)} from the true position`);
  }
}
