// The distance of the tightest pair against what it needs, over time, with closest approaches and collisions; click or drag to jump.

import uPlot from "./vendor/uplot.js";
import { mark } from "./dom.js";
import { clockTime, nearness } from "./format.js";

const AXIS_PX = 46, RIGHT_PX = 16;
const SNAP_PX = 7;
const SHORTEST_S = 10;
const SKIPPED_S = 1.0;
const MOST_MARKS = 120;
const MOST_POINTS = 6000;

export class Strip {
  #plot = null;
  #data = [[], [], []];
  #marks = [];
  #dirty = true;
  #pointsTo = "";
  #range = [0, SHORTEST_S];

  // onJump(t, encounter or null) when somebody points at a time.
  constructor(element, palette, onJump) {
    this.element = element;
    this.palette = palette;
    this.onJump = onJump;
    this.playhead = document.createElement("div");
    this.playhead.className = "playhead";
    this.restyle();
    new ResizeObserver(() => this.#resize()).observe(element);
  }

  // The extent of the plot: whoever draws below it aligns with this.
  get range() { return this.#range; }

  get overfull() { return this.#data[0].length > MOST_POINTS; }

  // The whole curve anew; what was appended since stays.
  replace({ from, step_s: step, nearest_m: tightest, required_m: required }) {
    const end = from + step * (tightest.length - 1);
    const later = this.#data[0].findIndex((t) => t > end + step / 2);
    const rest = later < 0 ? [[], [], []] : this.#data.map((column) => column.slice(later));
    const points = bridged(tightest, SKIPPED_S / step);
    const columns = [points.map((i) => from + i * step), points.map((i) => tightest[i]), points.map((i) => required[i])];
    this.#data = columns.map((column, i) => [...column, ...rest[i]]);
    this.#dirty = true;
  }

  append(t, tightest) {
    if (t <= (this.#data[0].at(-1) ?? -Infinity)) return;
    this.#data[0].push(t);
    this.#data[1].push(tightest?.[2] ?? null);
    this.#data[2].push(tightest?.[3] ?? null);
    this.#dirty = true;
  }

  clear() {
    this.#data = [[], [], []];
    this.#marks = [];
    this.#dirty = true;
  }

  // Encounters that are over, or that already are too near; of many the tightest.
  mark(encounters) {
    const known = encounters.filter((each) => Number.isFinite(each.closest_t) && (each.closed !== null || each.margin_m < 0));
    this.#marks = known.sort((a, b) => b.margin_m - a.margin_m).slice(-MOST_MARKS); // the tightest last, on top
    this.#dirty = true;
  }

  // The curves, if they have changed.
  draw(clock) {
    const range = [clock.t0, Math.max(clock.t1, clock.t0 + SHORTEST_S)];
    if (range[0] !== this.#range[0] || range[1] !== this.#range[1]) this.#dirty = true;
    if (!this.#dirty) return;
    this.#dirty = false;
    this.#range = range;
    this.#plot.setData(this.#data, false);
    this.#plot.batch(() => {
      this.#plot.setScale("x", { min: range[0], max: range[1] });
      this.#plot.setScale("y", { min: 0, max: this.#ceiling() });
    });
    this.#plot.redraw();
  }

  // The playhead.
  point(t) {
    const x = this.#plot.valToPos(Math.min(t, this.#range[1]), "x"); // the range of a live source is drawn now and then
    const transform = `translateX(${Math.max(0, x).toFixed(1)}px)`;
    if (transform === this.#pointsTo) return;
    this.#pointsTo = transform;
    this.playhead.style.transform = transform;
  }

  // Colours have changed.
  restyle() {
    this.#plot?.destroy();
    const { palette } = this;
    const axis = { stroke: palette.grid_text, font: `11px ${palette.font}`, ticks: { show: false } };
    const options = {
      width: Math.max(100, this.element.clientWidth), height: Math.max(60, this.element.clientHeight),
      padding: [8, RIGHT_PX, 0, 0],
      legend: { show: false },
      cursor: { drag: { x: false, y: false }, points: { show: false }, y: false },
      scales: { x: { time: false, auto: false }, y: { auto: false } },
      series: [
        {},
        { stroke: palette.accent, width: 1.75, points: { show: false } },
        { stroke: palette.near, width: 1.5, dash: [5, 4], points: { show: false } },
      ],
      axes: [
        { ...axis, size: 20, gap: 4, grid: { show: false }, values: (_, ticks) => ticks.map((t) => clockTime(t, 0)),
          incrs: [1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 1800, 3600, 7200, 14400], space: 70 },
        { ...axis, size: AXIS_PX, gap: 6, space: 26, grid: { stroke: palette.grid_strong, width: 1 },
          values: (_, ticks) => ticks.map((m) => `${m} m`) },
      ],
      hooks: { drawClear: [(plot) => this.#shade(plot)], draw: [(plot) => this.#drawMarks(plot)] },
    };
    this.#plot = new uPlot(options, this.#data, this.element);
    this.#plot.over.append(this.playhead);
    this.#listen(this.#plot.over);
    this.#dirty = true;
  }

  // High enough for what matters: a few times what is required.
  #ceiling() {
    let highest = 0, required = 0;
    for (const each of this.#data[1]) if (each > highest) highest = each;
    for (const each of this.#data[2]) if (each > required) required = each;
    return 1.08 * Math.max(10, Math.min(highest, required ? 4 * required : highest), required * 1.25);
  }

  // Where the discs of a pair overlapped.
  #shade(plot) {
    const [times, distance, required] = this.#data;
    const { ctx: context } = plot;
    context.fillStyle = this.palette.strip_shade;
    const x = (i) => plot.valToPos(times[i], "x", true), y = (metres) => plot.valToPos(metres, "y", true);
    let from = null;
    for (let i = 0; i <= times.length; i += 1) {
      const inside = i < times.length && distance[i] !== null && distance[i] < required[i];
      if (inside) from ??= i;
      else if (from !== null) {
        context.beginPath();
        for (let k = from; k < i; k += 1) context.lineTo(x(k), y(distance[k]));
        for (let k = i - 1; k >= from; k -= 1) context.lineTo(x(k), y(required[k]));
        context.fill();
        from = null;
      }
    }
  }

  #drawMarks(plot) {
    const { ctx: context } = plot, ratio = devicePixelRatio || 1;
    const { left, top, width, height } = plot.bbox;
    context.save();
    context.beginPath();
    context.rect(left - 6 * ratio, top - 6 * ratio, width + 12 * ratio, height + 8 * ratio);
    context.clip();
    context.setLineDash([]);
    context.lineWidth = 1.5 * ratio;
    for (const each of this.#marks) {
      const x = plot.valToPos(each.closest_t, "x", true);
      const y = Math.max(top + 4 * ratio, plot.valToPos(each.closest_m, "y", true));
      const kind = nearness(each.closest_m, each.closest_m - each.margin_m);
      const r = (each.collided ? 5.5 : kind === "clear" ? 2 : 3.5) * ratio;
      context.beginPath();
      if (each.collided) {
        context.moveTo(x, y - r);
        context.lineTo(x + r, y);
        context.lineTo(x, y + r);
        context.lineTo(x - r, y);
        context.closePath();
      } else context.arc(x, y, r, 0, 2 * Math.PI);
      context.fillStyle = each.collided ? this.palette.inside : this.palette.panel;
      context.strokeStyle = each.collided ? this.palette.inside : this.palette[kind];
      context.fill();
      context.stroke();
    }
    context.restore();
  }

  #listen(over) {
    let dragged = false;
    const jump = (event, snap) => {
      const { left, width } = over.getBoundingClientRect();
      const x = Math.min(width, Math.max(0, event.clientX - left));
      const near = snap ? this.#markAt(x) : null;
      this.onJump(near ? near.closest_t : this.#plot.posToVal(x, "x"), near);
    };
    over.addEventListener("pointerdown", (event) => {
      if (event.button !== 0) return;
      over.setPointerCapture(event.pointerId);
      dragged = true;
      jump(event, true);
    });
    over.addEventListener("pointermove", (event) => { if (dragged) jump(event, false); });
    over.addEventListener("pointerup", () => { dragged = false; });
    over.addEventListener("pointercancel", () => { dragged = false; });
  }

  #markAt(x) {
    let best = null, nearest = SNAP_PX;
    for (const each of this.#marks) {
      const distance = Math.abs(this.#plot.valToPos(each.closest_t, "x") - x);
      if (distance < nearest) [best, nearest] = [each, distance];
    }
    return best;
  }

  #resize() {
    const { clientWidth: width, clientHeight: height } = this.element;
    if (width > 50 && height > 30) this.#plot.setSize({ width, height });
    this.#dirty = true;
  }
}

// Places of a curve, without those gaps that are shorter than `longest`: an instant that was skipped is no absence.
function bridged(values, longest) {
  const places = [];
  let gap = [];
  values.forEach((value, i) => {
    if (value === null) {
      gap.push(i);
      return;
    }
    if (gap.length > longest) places.push(...gap);
    gap = [];
    places.push(i);
  });
  return places.concat(gap);
}
