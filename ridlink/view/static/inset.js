// Velocity space of the selected vehicle: which velocities it may fly, which it wants, chooses and flies.

import { prepare } from "./canvas.js";
import { label } from "./format.js";

const TURN = 2 * Math.PI;
const MOST_NAMES = 4;

// In a canvas of width times height CSS pixels.
export function drawInset(canvas, { width, height }, space, current, palette) {
  if (!width || !height) return;
  const context = prepare(canvas, { width, height });
  context.font = `10.5px ${palette.font}`;
  const fastest = Math.max(1, space?.max_speed ?? 0, Math.hypot(...(current ?? [0, 0])), ...extents(space));
  const scale = (Math.min(width, height) / 2 - 14) / (fastest * 1.04);
  const at = ([north, east]) => [width / 2 + east * scale, height / 2 - north * scale];
  const taken = rings(context, at, scale, fastest, width, palette);
  taken.push(...[space?.chosen, space?.preferred, space?.v].filter(Boolean).map(at));
  if (space) {
    planes(context, space.planes ?? [], at, { width, height, scale, taken }, palette);
    limits(context, space, at, scale, palette);
  }
  const now = space?.v ?? current;
  if (now) arrow(context, at([0, 0]), at(now), palette);
  if (space?.preferred) mark(context, at(space.preferred), palette.accent, false);
  if (space?.chosen) mark(context, at(space.chosen), palette.good, true);
}

function extents(space) {
  return [space?.preferred, space?.chosen].filter(Boolean).map((velocity) => Math.hypot(...velocity));
}

// Circles of equal speed; where their figures stand.
function rings(context, at, scale, fastest, width, palette) {
  const step = [1, 2, 5, 10, 20, 50, 100].find((each) => fastest / each <= 3.5) ?? 200;
  const [x, y] = at([0, 0]);
  context.strokeStyle = palette.grid_strong;
  context.fillStyle = palette.grid_text;
  context.lineWidth = 1;
  context.textAlign = "left";
  context.textBaseline = "middle";
  context.beginPath();
  for (let speed = step; speed <= fastest * 1.3; speed += step) {
    context.moveTo(x + speed * scale, y);
    context.arc(x, y, speed * scale, 0, TURN);
  }
  context.moveTo(0, y);
  context.lineTo(width, y);
  context.moveTo(x, 0);
  context.lineTo(x, 2 * y);
  context.stroke();
  const written = [];
  for (let speed = step; speed <= fastest; speed += step) {
    const last = speed + step > fastest;
    context.fillText(last ? `${speed} m/s` : `${speed}`, x + 4, y - speed * scale + 8);
    written.push([x + 14, y - speed * scale + 8]);
  }
  return written;
}

// normal . v >= offset is admissible: the other side of each line is shaded, as one area, so that shades do not add up.
function planes(context, list, at, { width, height, scale, taken }, palette) {
  const far = 4 * (width + height) / scale;
  const edges = list.map(([north, east, offset, name]) => {
    const size = Math.hypot(north, east) || 1;
    const n = [north / size, east / size], foot = [n[0] * offset / size, n[1] * offset / size];
    const along = [-n[1], n[0]];
    return { n, foot, along, name };
  });
  context.beginPath();
  for (const { n, foot, along } of edges) {
    [[-1, 0], [1, 0], [1, -1], [-1, -1]].forEach(([a, b], i) => {
      const [x, y] = at([foot[0] + far * (a * along[0] + b * n[0]), foot[1] + far * (a * along[1] + b * n[1])]);
      if (i) context.lineTo(x, y);
      else context.moveTo(x, y);
    });
    context.closePath();
  }
  context.fillStyle = palette.forbidden;
  context.fill("nonzero");
  context.strokeStyle = palette.forbidden_edge;
  context.lineWidth = 1.25;
  context.beginPath();
  for (const { foot, along } of edges) {
    context.moveTo(...at([foot[0] - far * along[0], foot[1] - far * along[1]]));
    context.lineTo(...at([foot[0] + far * along[0], foot[1] + far * along[1]]));
  }
  context.stroke();
  names(context, edges, at, { width, height, taken }, palette);
}

// Whose constraint a line is, where the line is nearest the middle and there is room.
function names(context, edges, at, { width, height, taken }, palette) {
  const named = new Set();
  context.textBaseline = "middle";
  context.textAlign = "center";
  for (const { n, foot, name } of edges) {
    if (named.size >= MOST_NAMES) break;
    if (named.has(name)) continue;
    const [fx, fy] = at(foot);
    const x = fx - 14 * n[1], y = fy + 14 * n[0];
    if (x < 24 || y < 10 || x > width - 24 || y > height - 10) continue;
    if (taken.some(([tx, ty]) => Math.abs(tx - x) < 52 && Math.abs(ty - y) < 13)) continue;
    taken.push([x, y]);
    named.add(name);
    const text = label(String(name ?? ""), 12);
    context.lineWidth = 3;
    context.strokeStyle = palette.ground;
    context.strokeText(text, x, y);
    context.fillStyle = palette.alarm;
    context.fillText(text, x, y);
  }
}

function limits(context, space, at, scale, palette) {
  const [x, y] = at([0, 0]);
  context.strokeStyle = palette.edge;
  context.lineWidth = 1.5;
  context.beginPath();
  context.arc(x, y, space.max_speed * scale, 0, TURN);
  context.stroke();
  if (!space.reachable) return;
  const [cx, cy] = at(space.reachable.centre);
  context.setLineDash([4, 4]);
  context.beginPath();
  context.arc(cx, cy, space.reachable.radius * scale, 0, TURN);
  context.stroke();
  context.setLineDash([]);
}

function arrow(context, [x, y], [tx, ty], palette) {
  const long = Math.hypot(tx - x, ty - y);
  context.strokeStyle = palette.vehicle;
  context.lineWidth = 2;
  context.beginPath();
  context.moveTo(x, y);
  context.lineTo(tx, ty);
  if (long > 6) {
    const [ux, uy] = [(tx - x) / long, (ty - y) / long];
    context.moveTo(tx - 7 * ux - 4 * uy, ty - 7 * uy + 4 * ux);
    context.lineTo(tx, ty);
    context.lineTo(tx - 7 * ux + 4 * uy, ty - 7 * uy - 4 * ux);
  }
  context.stroke();
  if (long <= 6) mark(context, [tx, ty], palette.vehicle, true);
}

function mark(context, [x, y], colour, filled) {
  context.beginPath();
  context.arc(x, y, filled ? 4.5 : 6.5, 0, TURN);
  context.lineWidth = 2;
  context.strokeStyle = filled ? "transparent" : colour;
  context.fillStyle = colour;
  if (filled) context.fill();
  else context.stroke();
}
