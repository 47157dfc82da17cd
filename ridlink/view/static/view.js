import { DISPLACEMENT, E, N } from "./picture.js";

const EDGE_PX = 8;

// Where metres are on the plan. Its numbers are all there is to it: whoever paints elsewhere makes a view of its own of them.

// width and height [CSS px], scale [px/m], x0 and y0 (where north and east are 0) [px], ratio: pixels of the canvas in one.
export function viewOf({ width, height, scale, x0, y0, ratio }) {
  return {
    width, height, scale, ratio,
    x: (east) => x0 + east * scale,
    y: (north) => y0 - north * scale,
    north: (y) => (y0 - y) / scale,
    east: (x) => (x - x0) / scale,
  };
}

// Whether everybody is in the picture, disc and all.
export function holdsDiscs(view, frame) {
  for (let i = 0; i < frame.count; i += 1) {
    const x = view.x(frame.value(i, E)), y = view.y(frame.value(i, N));
    const r = (frame.value(i, DISPLACEMENT) || 0) * view.scale + EDGE_PX;
    if (x < r || y < r || x > view.width - r || y > view.height - r) return false;
  }
  return true;
}
