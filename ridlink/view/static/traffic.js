// Everybody in the air, in one pass: discs, trails, pairs, true positions, arrows, darts, names.

import { nearness } from "./format.js";
import {
  AIRFRAME, DISPLACEMENT, E, ERROR, FIELDS, N, STALE, STATUS, STRANGER, TRUE_E, TRUE_N, VE, VN,
} from "./picture.js";

const TURN = 2 * Math.PI;
const ARROW_S = 2; // an arrow ends where its vehicle is so much later
const FAR_PX_PER_M = 1, HIDDEN_PX = 5; // seen from afar, a true position that its dart covers is left out
const CROWD = 60;
const MANY_PAIRS = 30; // with more of them, harmless pairs are shown of the selected vehicle alone
const SMOOTH_PX = 5; // a trail has a point only every so many
const MANY_INSIDE = 10; // with more of them, those of others are fainter

export function drawTraffic(context, view, scene, palette) {
  const { frame } = scene;
  const chosen = frame.index(scene.selected);
  discs(context, view, frame, palette);
  trails(context, view, scene, palette);
  pairs(context, view, frame, chosen, palette);
  if (chosen >= 0) selection(context, view, scene, chosen, palette);
  truths(context, view, frame, palette);
  arrows(context, view, frame, palette);
  darts(context, view, frame, palette);
  scene.labels.draw(context, view, frame, scene.selected, palette);
}

// All rings of one kind are one path: where discs overlap, tints do not add up.
function discs(context, view, frame, palette) {
  const fill = (outer, colour) => {
    context.fillStyle = colour;
    context.beginPath();
    each(view, frame, outer, (x, y, r) => {
      context.moveTo(x + r, y);
      context.arc(x, y, r, 0, TURN);
    });
    context.fill();
  };
  fill(ERROR, palette.ring_error);
  // The outermost ring as a line of its own width, in the middle of that width.
  context.strokeStyle = palette.ring_displacement;
  const { values } = frame;
  for (let i = 0; i < frame.count; i += 1) {
    const at = i * FIELDS, outer = values[at + DISPLACEMENT], inner = values[at + ERROR];
    const width = (outer - inner) * view.scale;
    if (!(width > 0.3)) continue;
    const x = view.x(values[at + E]), y = view.y(values[at + N]), r = (outer + inner) / 2 * view.scale;
    if (outside(view, x, y, r + width)) continue;
    context.lineWidth = width;
    context.beginPath();
    context.arc(x, y, r, 0, TURN);
    context.stroke();
  }
  context.strokeStyle = palette.ring_edge;
  context.lineWidth = 1;
  context.beginPath();
  each(view, frame, DISPLACEMENT, (x, y, r) => {
    context.moveTo(x + r, y);
    context.arc(x, y, r, 0, TURN);
  });
  context.stroke();
  fill(AIRFRAME, palette.ring_airframe);
}

function each(view, frame, field, visit) {
  const { values } = frame;
  for (let at = 0; at < frame.count * FIELDS; at += FIELDS) {
    const r = values[at + field] * view.scale;
    if (!(r > 1)) continue;
    const x = view.x(values[at + E]), y = view.y(values[at + N]);
    if (!outside(view, x, y, r)) visit(x, y, r);
  }
}

function outside(view, x, y, r) {
  return x < -r || y < -r || x > view.width + r || y > view.height + r;
}

// Older thirds of a trail are fainter.
function trails(context, view, scene, palette) {
  const { frame } = scene, { starts, points } = scene.trails;
  context.strokeStyle = palette.trail;
  context.lineJoin = "bevel";
  for (const [third, alpha] of [[0, 0.2], [1, 0.42], [2, 0.75]]) {
    context.globalAlpha = alpha;
    context.lineWidth = frame.count > CROWD ? 1 : 1.25; // hairlines are drawn several times as fast
    context.beginPath();
    for (let i = 0; i < frame.count; i += 1) {
      const start = starts[i], length = starts[i + 1] - start;
      if (!length) continue;
      const from = start + Math.floor(length / 6 * third) * 2;
      const to = third === 2 ? start + length : start + Math.floor(length / 6 * (third + 1)) * 2 + 2;
      let lastX = NaN, lastY = NaN;
      for (let at = from; at < to; at += 2) {
        const x = view.x(points[at + 1]), y = view.y(points[at]);
        if (at === from) context.moveTo(x, y);
        else if (at < to - 2 && Math.abs(x - lastX) + Math.abs(y - lastY) < SMOOTH_PX) continue;
        else context.lineTo(x, y);
        [lastX, lastY] = [x, y];
      }
      if (third === 2) context.lineTo(view.x(frame.value(i, E)), view.y(frame.value(i, N)));
    }
    context.stroke();
  }
  context.globalAlpha = 1;
}

function pairs(context, view, frame, chosen, palette) {
  const { pairs: list, values } = frame;
  const groups = { clear: [], near: [], inside: [], own: [] };
  for (let at = 0; at < list.length; at += 5) {
    const i = list[at], j = list[at + 1], kind = nearness(list[at + 2], list[at + 3]);
    if (i >= frame.count || j >= frame.count) continue;
    const own = i === chosen || j === chosen;
    if (kind === "clear" && !own && list.length / 5 > MANY_PAIRS) continue;
    groups[kind === "inside" && own ? "own" : kind].push(i * FIELDS, j * FIELDS);
  }
  const crowded = groups.inside.length / 2 > MANY_INSIDE;
  const styles = {
    clear: [palette.clear, 1.25, [1.5, 5], 1], near: [palette.near, 1.75, [7, 5], 1],
    inside: [palette.inside, crowded ? 1.25 : 2.5, [], crowded ? 0.4 : 1], own: [palette.inside, 2.5, [], 1],
  };
  for (const [kind, ends] of Object.entries(groups)) {
    const [colour, width, dash, alpha] = styles[kind];
    context.strokeStyle = colour;
    context.lineWidth = width;
    context.globalAlpha = alpha;
    context.setLineDash(dash);
    context.beginPath();
    for (let k = 0; k < ends.length; k += 2) {
      context.moveTo(view.x(values[ends[k] + E]), view.y(values[ends[k] + N]));
      context.lineTo(view.x(values[ends[k + 1] + E]), view.y(values[ends[k + 1] + N]));
    }
    context.stroke();
  }
  context.globalAlpha = 1;
  context.setLineDash([]);
}

function selection(context, view, scene, chosen, palette) {
  const { frame } = scene;
  const x = view.x(frame.value(chosen, E)), y = view.y(frame.value(chosen, N));
  const r = Math.max(12, frame.value(chosen, DISPLACEMENT) * view.scale || 0);
  context.strokeStyle = palette.accent;
  context.lineWidth = 2;
  context.beginPath();
  context.arc(x, y, r, 0, TURN);
  context.stroke();
  const goal = scene.goals[scene.selected];
  if (!goal) return;
  context.globalAlpha = 0.75;
  context.lineWidth = 1.25;
  context.setLineDash([3, 5]);
  context.beginPath();
  context.moveTo(x, y);
  context.lineTo(view.x(goal[1]), view.y(goal[0]));
  context.stroke();
  context.setLineDash([]);
  context.globalAlpha = 1;
}

function truths(context, view, frame, palette) {
  const { values } = frame, far = view.scale < FAR_PX_PER_M;
  context.strokeStyle = palette.truth;
  context.lineWidth = 1.5;
  context.beginPath();
  for (let at = 0; at < frame.count * FIELDS; at += FIELDS) {
    const x = view.x(values[at + TRUE_E]), y = view.y(values[at + TRUE_N]);
    if (!Number.isFinite(x) || outside(view, x, y, 10)) continue;
    const rx = view.x(values[at + E]), ry = view.y(values[at + N]);
    if (far && Math.hypot(rx - x, ry - y) < HIDDEN_PX) continue;
    context.moveTo(x + 4.5, y);
    context.arc(x, y, 4.5, 0, TURN);
    context.moveTo(x, y);
    context.lineTo(rx, ry);
  }
  context.stroke();
}

function arrows(context, view, frame, palette) {
  const { values } = frame;
  context.strokeStyle = palette.velocity;
  context.lineWidth = 1.5;
  context.beginPath();
  for (let at = 0; at < frame.count * FIELDS; at += FIELDS) {
    const dx = values[at + VE] * ARROW_S * view.scale, dy = -values[at + VN] * ARROW_S * view.scale;
    const long = Math.hypot(dx, dy);
    if (!(long > 12)) continue;
    const x = view.x(values[at + E]), y = view.y(values[at + N]);
    if (outside(view, x, y, long)) continue;
    const [ux, uy] = [dx / long, dy / long], tx = x + dx, ty = y + dy;
    context.moveTo(x, y);
    context.lineTo(tx, ty);
    context.moveTo(tx - 5 * ux - 3.5 * uy, ty - 5 * uy + 3.5 * ux);
    context.lineTo(tx, ty);
    context.lineTo(tx - 5 * ux + 3.5 * uy, ty - 5 * uy - 3.5 * ux);
  }
  context.stroke();
}

function darts(context, view, frame, palette) {
  const { values } = frame;
  const size = frame.count > CROWD ? 6 : 8;
  for (const [kind, colour] of [[0, palette.vehicle], [STRANGER, palette.stranger], [STALE, palette.stale]]) {
    context.fillStyle = colour;
    context.strokeStyle = palette.ground;
    context.lineWidth = 1;
    context.beginPath();
    for (let at = 0; at < frame.count * FIELDS; at += FIELDS) {
      if (kindOf(values[at + STATUS]) !== kind) continue;
      const x = view.x(values[at + E]), y = view.y(values[at + N]);
      if (!Number.isFinite(x) || outside(view, x, y, size)) continue;
      const speed = Math.hypot(values[at + VN], values[at + VE]);
      if (speed > 0.5) dart(context, x, y, values[at + VE] / speed, -values[at + VN] / speed, size);
      else {
        context.moveTo(x + size / 2, y);
        context.arc(x, y, size / 2, 0, TURN);
      }
    }
    context.stroke();
    context.fill();
  }
}

export function kindOf(status) {
  if (status & STALE) return STALE;
  return status & STRANGER ? STRANGER : 0;
}

function dart(context, x, y, ux, uy, size) {
  context.moveTo(x + size * ux, y + size * uy);
  context.lineTo(x - 0.8 * size * ux - 0.65 * size * uy, y - 0.8 * size * uy + 0.65 * size * ux);
  context.lineTo(x - 0.4 * size * ux, y - 0.4 * size * uy);
  context.lineTo(x - 0.8 * size * ux + 0.65 * size * uy, y - 0.8 * size * uy - 0.65 * size * ux);
  context.closePath();
}
