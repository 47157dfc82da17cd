// What does not move: the grid with its metres, obstacles, goals.

const APART_PX = 90;

// 1, 2 or 5 times a power of ten, at least `least`.
function roundLength(least) {
  const power = 10 ** Math.floor(Math.log10(least));
  return [1, 2, 5, 10].map((times) => times * power).find((length) => length >= least);
}

export function drawGround(context, view, scene, palette) {
  const step = roundLength(APART_PX / view.scale);
  lines(context, view, step / 5, palette.grid);
  lines(context, view, step, palette.grid_strong);
  obstacles(context, view, scene.obstacles, palette);
  goals(context, view, scene, palette);
  figures(context, view, step, palette);
}

function lines(context, view, step, colour) {
  context.strokeStyle = colour;
  context.lineWidth = 1;
  context.beginPath();
  for (let east = Math.ceil(view.east(0) / step) * step; view.x(east) < view.width; east += step) {
    const x = Math.round(view.x(east)) + 0.5;
    context.moveTo(x, 0);
    context.lineTo(x, view.height);
  }
  for (let north = Math.ceil(view.north(view.height) / step) * step; view.y(north) > 0; north += step) {
    const y = Math.round(view.y(north)) + 0.5;
    context.moveTo(0, y);
    context.lineTo(view.width, y);
  }
  context.stroke();
}

// Metres along the upper and the left edge; north is up.
function figures(context, view, step, palette) {
  const digits = step < 1 ? 1 : 0;
  const text = (value) => (Math.abs(value) < step / 2 ? "0" : value.toFixed(digits).replace("-", "−"));
  context.font = `10.5px ${palette.font}`;
  context.fillStyle = palette.grid_text;
  context.textAlign = "center";
  context.textBaseline = "top";
  for (let east = Math.ceil(view.east(0) / step) * step; view.x(east) < view.width - 104; east += step) {
    if (view.x(east) > 70) context.fillText(text(east), view.x(east), 6);
  }
  context.fillText("E m →", view.width - 72, 6);
  context.textAlign = "left";
  context.textBaseline = "middle";
  for (let north = Math.ceil(view.north(view.height) / step) * step; view.y(north) > 36; north += step) {
    if (view.y(north) < view.height - 12) context.fillText(text(north), 7, view.y(north));
  }
  context.textBaseline = "top";
  context.fillText("↑ N m", 7, 6);
}

function obstacles(context, view, polygons, palette) {
  for (const polygon of polygons) {
    context.beginPath();
    polygon.forEach(([north, east], i) => {
      if (i) context.lineTo(view.x(east), view.y(north));
      else context.moveTo(view.x(east), view.y(north));
    });
    context.closePath();
    context.fillStyle = palette.obstacle;
    context.fill();
    context.strokeStyle = palette.obstacle_edge;
    context.lineWidth = 1.5;
    context.stroke();
  }
}

function goals(context, view, scene, palette) {
  for (const [name, [north, east]] of Object.entries(scene.goals)) {
    const x = view.x(east), y = view.y(north), chosen = name === scene.selected, r = chosen ? 7 : 5;
    context.beginPath();
    context.moveTo(x, y - r);
    context.lineTo(x + r, y);
    context.lineTo(x, y + r);
    context.lineTo(x - r, y);
    context.closePath();
    context.strokeStyle = chosen ? palette.accent : palette.goal;
    context.lineWidth = chosen ? 2 : 1.25;
    context.stroke();
  }
}
