// Paints the plan: the ground and, above it, everybody in the air. Needs no document, so that it works beside the page, too.

import { prepare } from "./canvas.js";
import { drawGround } from "./ground.js";
import { Labels } from "./labels.js";
import { FIELDS } from "./picture.js";
import { drawTraffic } from "./traffic.js";
import { viewOf } from "./view.js";

export class Painter {
  #ground;
  #traffic;
  #labels = new Labels();
  #shown = new Shown();
  #trails = null;
  #look = null;

  constructor({ ground, traffic }) {
    this.#ground = ground;
    this.#traffic = traffic;
  }

  // `names`, `trails` and `look` (scene and palette; with it the ground is painted) only when they have changed.
  paint({ numbers, names, values, pairs, trails, look, now }) {
    const view = viewOf(numbers), shown = this.#shown;
    shown.take(names, values, pairs);
    this.#trails = trails ?? this.#trails;
    this.#look = look ?? this.#look;
    const { scene, palette } = this.#look;
    if (look) drawGround(prepare(this.#ground, view), view, scene, palette);
    this.#labels.place(shown, view, scene.selected, now);
    const everything = { frame: shown, trails: this.#trails, labels: this.#labels, ...scene };
    drawTraffic(prepare(this.#traffic, view), view, everything, palette);
  }
}

// Who is in the air at the instant that is painted.
class Shown {
  names = [];
  #places = new Map();

  take(names, values, pairs) {
    if (names) {
      this.names = names;
      this.#places = new Map(names.map((name, i) => [name, i]));
    }
    Object.assign(this, { values, pairs });
  }

  get count() { return this.names.length; }

  index(name) { return this.#places.get(name) ?? -1; }

  value(index, field) { return this.values[index * FIELDS + field]; }
}
