// Names beside vehicles, so that they neither cover each other nor jump about.

import { label, nearness } from "./format.js";
import { E, N } from "./picture.js";

const PLACED_EVERY_MS = 250;
const MOST = 70;
const HEIGHT = 14;
const GAP = 9;
const SLOTS = [[1, -1], [1, 1], [-1, -1], [-1, 1]]; // right above, right below, left above, left below

export class Labels {
  #slots = new Map(); // name -> [x, y] signs
  #widths = new Map();
  #texts = new Map();
  #placedAt = -Infinity;
  #scale = 0;

  // Choose who gets a label and where: the selected one first, then those in a near pair, then who fits.
  place(frame, view, selected, now) {
    if (now - this.#placedAt < PLACED_EVERY_MS && view.scale === this.#scale) return;
    this.#placedAt = now;
    this.#scale = view.scale;
    const before = this.#slots;
    this.#slots = new Map();
    const taken = [];
    const darts = [];
    for (let i = 0; i < frame.count; i += 1) darts.push([view.x(frame.value(i, E)), view.y(frame.value(i, N))]);
    for (const i of this.#order(frame, selected)) {
      if (this.#slots.size >= MOST) break;
      const [x, y] = darts[i], name = frame.names[i];
      if (!(x > 0 && y > 0 && x < view.width && y < view.height)) continue;
      const width = this.#width(name), was = before.get(name), chosen = name === selected;
      const slots = was ? [was, ...SLOTS] : SLOTS;
      const free = (box) => inside(box, view) && (chosen
        || !(taken.some((other) => overlap(box, other)) || darts.some((dart, j) => j !== i && covers(box, dart))));
      const slot = slots.find((each) => free(boxOf(x, y, each, width))) ?? (chosen ? slots[0] : null);
      if (!slot) continue;
      taken.push(boxOf(x, y, slot, width));
      this.#slots.set(name, slot);
    }
  }

  draw(context, view, frame, selected, palette) {
    context.textBaseline = "middle";
    context.textAlign = "left";
    context.lineWidth = 3;
    context.lineJoin = "round";
    context.strokeStyle = palette.ground;
    const many = frame.count > 60;
    for (let i = 0; i < frame.count; i += 1) {
      const name = frame.names[i], slot = this.#slots.get(name);
      if (!slot) continue;
      const chosen = name === selected;
      context.font = `${chosen ? 600 : 400} 11px ${palette.font}`;
      const x = view.x(frame.value(i, E)), y = view.y(frame.value(i, N));
      const [left, top] = boxOf(x, y, slot, this.#width(name, context));
      if (!many || chosen) context.strokeText(this.#text(name), left, top + HEIGHT / 2);
      context.fillStyle = chosen ? palette.text : palette.muted;
      context.fillText(this.#text(name), left, top + HEIGHT / 2);
    }
  }

  #order(frame, selected) {
    const urgent = new Set();
    const { pairs } = frame;
    for (let at = 0; at < pairs.length; at += 5) {
      if (nearness(pairs[at + 2], pairs[at + 3]) !== "clear") urgent.add(pairs[at]).add(pairs[at + 1]);
    }
    const chosen = frame.index(selected);
    const rank = (i) => (i === chosen ? 0 : urgent.has(i) ? 1 : this.#slots.has(frame.names[i]) ? 2 : 3);
    return [...Array(frame.count).keys()].sort((a, b) => rank(a) - rank(b) || a - b);
  }

  #text(name) {
    let text = this.#texts.get(name);
    if (text === undefined) {
      text = label(name, 14);
      if (this.#texts.size > 3000) this.#texts.clear();
      this.#texts.set(name, text);
    }
    return text;
  }

  // Until a canvas has measured it, a label is as wide as its letters usually are.
  #width(name, context) {
    const known = this.#widths.get(name);
    if (known !== undefined) return known;
    if (!context) return this.#text(name).length * 6.5;
    if (this.#widths.size > 3000) this.#widths.clear();
    const width = context.measureText(this.#text(name)).width;
    this.#widths.set(name, width);
    return width;
  }
}

function boxOf(x, y, [sx, sy], width) {
  return [sx > 0 ? x + GAP : x - GAP - width, y + sy * GAP - HEIGHT / 2, width, HEIGHT];
}

function inside([x, y, width, height], view) {
  return x >= 0 && y >= 0 && x + width <= view.width && y + height <= view.height;
}

function overlap([ax, ay, aw, ah], [bx, by, bw, bh]) {
  return ax < bx + bw && bx < ax + aw && ay < by + bh && by < ay + ah;
}

function covers([x, y, width, height], [px, py]) {
  return px > x - 4 && px < x + width + 4 && py > y - 4 && py < y + height + 4;
}
