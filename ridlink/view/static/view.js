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
