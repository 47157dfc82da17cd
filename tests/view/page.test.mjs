// The modules of the page that draw nothing, run by node: see test_page_files.py.

import assert from "node:assert/strict";
import test from "node:test";

const from = (name) => import(new URL(`../../ridlink/view/static/${name}`, import.meta.url));
const [{ Clock }, { Frame }, { History }, { Loader }, { Trails }, format, picture, { readUrl, urlOf }, { holdsDiscs, viewOf }, { Awaited, covered }] =
  await Promise.all(["clock.js", "frame.js", "history.js", "loader.js", "trails.js", "format.js", "picture.js", "url.js",
    "view.js", "awaited.js"].map(from));
const { E, FIELDS, N, pack } = picture;

globalThis.matchMedia = () => ({ matches: false });

const vehicle = (name, north, east, vn = 0, ve = 0) => [name, north, east, vn, ve, 0.3, 10.8, 11.8, 0.05, 100, null, null, 0];
const instant = (t, ...vehicles) => pack({ t, vehicles, pairs: [], tightest: null, selected: null }, "candidate2");

function historyOf(...pictures) {
  const history = new History();
  for (const each of pictures) history.add(each, 0);
  return history;
}

test("what is unknown stays unknown when packed", () => {
  const { values } = instant(0, vehicle("a", 1, 2));
  assert.deepEqual([values[N], values[E]], [1, 2]);
  assert.ok(Number.isNaN(values[picture.TRUE_N]));
  assert.ok(Number.isNaN(pack({ t: 0, vehicles: [["b", "1", {}, null]] }, "x").values[N]));
});

test("the history is in order however it comes in, and keeps one picture of an instant", () => {
  const history = historyOf(...[5, 1, 3, 2, 4, 3].map((t) => instant(t, vehicle("a", t, 0))));
  assert.deepEqual([...Array(history.length).keys()].map((i) => history.at(i).t), [1, 2, 3, 4, 5]);
  assert.equal(history.at(history.before(3.7)).t, 3);
  assert.equal(history.before(0.5), -1);
});

test("the history is bounded, and keeps what lies near the instant shown", () => {
  const many = Array.from({ length: 250 }, (_, i) => vehicle(`v${i}`, i, 0));
  const history = new History();
  let dropped = false;
  for (let t = 0; t < 2500; t += 1) dropped = history.add(instant(t, ...many), 2499) || dropped;
  assert.ok(dropped && history.length * 250 <= 500_000);
  assert.equal(history.last, 2499);
});

test("between two instants a vehicle is between its two positions, by name and not by place in the list", () => {
  const history = historyOf(
    instant(0, vehicle("a", 0, 0), vehicle("b", 100, 0)), instant(1, vehicle("b", 110, 0), vehicle("a", 0, 20)));
  const frame = new Frame();
  assert.ok(frame.at(history, 0.25, 0));
  assert.deepEqual([frame.value(0, E), frame.value(1, N)], [5, 102.5]);
});

test("the history of one vehicle is bounded as well: what a picture takes besides its vehicles counts", () => {
  const history = new History();
  for (let t = 0; t < 30_000; t += 1) history.add(instant(t, vehicle("a", t, 0)), 29_999);
  assert.ok(history.length < 20_000, String(history.length));
  assert.equal(history.last, 29_999);
  history.purge(0, 30_000, "another");
  for (let t = 0; t < 10_000; t += 1) history.add(instant(t), 9999);
  assert.equal(history.length, 10_000, "what was purged counts no more");
});

// Where each of these came from: name -> [[north, east], ...], oldest first.
function trailsOf(history, t, names) {
  const trails = new Trails();
  trails.update(history, t, 0, names);
  const { starts, points } = trails.lines;
  const pairs = (from, to) => Array.from({ length: (to - from) / 2 }, (_, k) => [...points.slice(from + 2 * k, from + 2 * k + 2)]);
  return Object.fromEntries(names.map((name, i) => [name, pairs(starts[i], starts[i + 1])]));
}

test("a trail is of whom it was, wherever its name stood in the list", () => {
  const history = historyOf(
    instant(0, vehicle("a", 0, 0), vehicle("b", 100, 0)), instant(0.5, vehicle("b", 101, 0), vehicle("a", 1, 0)),
    instant(1, vehicle("b", 102, 0)), instant(1.5, vehicle("b", 103, 0), vehicle("a", 3, 0)));
  const found = trailsOf(history, 1.5, ["b", "a", "nobody"]);
  assert.deepEqual(found, { b: [[100, 0], [101, 0], [102, 0], [103, 0]], a: [[0, 0], [1, 0], [3, 0]], nobody: [] });
});

test("a trail begins anew where nothing was heard for long, and is gone when nothing is heard any more", () => {
  const history = historyOf(...[0, 0.5, 8, 8.5].map((t) => instant(t, vehicle("a", t, 0))));
  assert.deepEqual(trailsOf(history, 8.5, ["a"]).a, [[8, 0], [8.5, 0]]);
  assert.deepEqual(trailsOf(history, 12, ["a"]).a, []);
});

test("trails are collected anew when time has moved on by a step, the history has changed or others are in the air", () => {
  const history = historyOf(...[0, 0.5, 1].map((t) => instant(t, vehicle("a", t, 0), vehicle("b", -t, 0))));
  const trails = new Trails(), names = ["a"];
  let before = trails.lines;
  const anew = (...given) => {
    trails.update(history, ...given);
    const changed = trails.lines !== before;
    before = trails.lines;
    return changed;
  };
  assert.deepEqual([anew(0.5, 0, names), anew(0.9, 0, names), anew(1, 0, names), anew(1, 1, names), anew(1, 1, ["b"])],
    [true, false, true, true, true]);
});

test("a view and the numbers it was made of say the same about a place", () => {
  const view = viewOf({ width: 800, height: 600, scale: 2, x0: 400, y0: 300, ratio: 1 });
  assert.deepEqual([view.x(10), view.y(10), view.east(view.x(-3)), view.north(view.y(7))], [420, 280, -3, 7]);
});

test("past the last instant it flies on with its velocity, for a second", () => {
  const history = historyOf(instant(0, vehicle("a", 0, 0, 10, 0)));
  const frame = new Frame();
  frame.at(history, 0.5, 0);
  assert.equal(frame.value(0, N), 5);
  frame.at(history, 60, 0);
  assert.equal(frame.value(0, N), 10);
});

test("where the history has a hole, nothing is made up; where it is complete, nobody was in the air", () => {
  const history = historyOf(instant(0, vehicle("a", 0, 0)), instant(100, vehicle("a", 0, 0)));
  const frame = new Frame();
  assert.equal(frame.at(history, 50, 0), false);
  assert.ok(frame.at(history, 50, 0, true));
  assert.deepEqual([frame.count, frame.index("a"), frame.tightest], [0, -1, null]);
});

test("a sky that was empty stays empty until somebody comes", () => {
  const frame = new Frame();
  assert.ok(frame.at(historyOf(instant(0), instant(100, vehicle("a", 0, 0))), 50, 0));
  assert.equal(frame.count, 0);
});

test("the next picture is another one, though nobody moves into it", () => {
  const frame = new Frame();
  const history = historyOf(instant(0), instant(3, vehicle("a", 0, 0)), instant(4, vehicle("a", 0, 0)));
  assert.ok(frame.isOther(history, 0));
  frame.at(history, 0, 0);
  assert.deepEqual([0, 1, 2.9, 3, 4].map((t) => frame.isOther(history, t)), [false, false, false, true, true]);
  frame.at(history, 3.2, 0);
  assert.deepEqual([frame.count, frame.isOther(history, 3.9), frame.isOther(history, 4.1)], [1, false, true]);
});

test("rings change within a moment when the definition does", () => {
  const frame = new Frame();
  frame.at(historyOf(instant(0, vehicle("a", 0, 0))), 0, 0);
  frame.growFromHere(0);
  const wide = pack({ t: 0, vehicles: [["a", 0, 0, 0, 0, 3.75, 43.75, 44.75, 0, 0, null, null, 0]] }, "remote-id");
  frame.at(historyOf(wide), 0, 0);
  assert.equal(frame.value(0, picture.ERROR), Math.fround(10.8));
  frame.at(historyOf(wide), 0, 175);
  assert.ok(frame.value(0, picture.ERROR) > 20 && frame.value(0, picture.ERROR) < 35);
  frame.at(historyOf(wide), 0, 400);
  assert.equal(frame.value(0, picture.ERROR), 43.75);
  assert.equal(frame.growing, false);
});

test("the clock follows smoothly, a little behind, at any pace of the source and never backwards", () => {
  for (const pace of [0.5, 1, 5]) {
    const clock = new Clock(() => {});
    clock.follow();
    let before = -Infinity;
    for (let now = 0; now < 20_000; now += 16) {
      if (now % 96 === 0) clock.arrived(pace * now / 1000, now + 20 * Math.sin(now));
      const t = clock.tick(now, true);
      if (now > 8000) {
        assert.ok(t >= before, `backwards at ${now}`);
        assert.ok(Math.abs(pace * now / 1000 - t) < 0.5 * Math.max(1, pace), `${pace}: ${pace * now / 1000 - t}`);
      }
      before = t;
    }
  }
});

test("the clock plays both ways and stops at the ends; at the end of a live source it follows", () => {
  const clock = new Clock(() => {});
  clock.extent(10, 20);
  clock.seek(15);
  clock.setSpeed(2);
  clock.play(-1);
  for (let now = 0; now <= 4000; now += 100) clock.tick(now, false);
  assert.deepEqual([clock.t, clock.playing], [10, false]);
  clock.play(1);
  for (let now = 4000; now <= 12_000; now += 100) clock.tick(now, false);
  assert.deepEqual([clock.t, clock.playing], [20, false]);
  clock.seek(19.9);
  clock.play(1);
  for (let now = 12_000; now <= 13_000; now += 100) clock.tick(now, true);
  assert.ok(clock.following);
});

test("seeking stays within what there is", () => {
  const clock = new Clock(() => {});
  clock.extent(10, 20);
  clock.seek(-5);
  assert.equal(clock.t, 10);
  clock.seek(1e9);
  assert.equal(clock.t, 20);
});

// A loader, what stretches it asked for, and what single instants.
function watched() {
  const asked = [], instants = [];
  return { asked, instants, loader: new Loader((request) => ("at" in request ? instants : asked).push(request)) };
}

test("the loader asks for the instant and its stretch once, then for what comes, and anew for another definition", () => {
  const { asked, instants, loader } = watched();
  const clock = { t: 65, t0: 0, t1: 1000, rate: 1 };
  loader.look("candidate2", null);
  loader.want(clock, 8, 0.1, 0);
  loader.want(clock, 8, 0.1, 10);
  assert.deepEqual(asked.map((each) => each.window), [[60, 90]]);
  assert.deepEqual(instants.map((each) => each.at), [65]);
  assert.equal(loader.answered({ id: asked[0].id, done: false }), null);
  assert.deepEqual([loader.answered({ id: asked[0].id, done: true })].map(({ from, to }) => [from, to]), [[60, 90]]);
  for (let now = 20; now < 60; now += 10) {
    loader.want(clock, 8, 0.1, now);
    loader.answered({ id: asked.at(-1).id, done: true });
  }
  assert.deepEqual(asked.map((each) => each.window), [[60, 90], [90, 120], [30, 60]]);
  loader.look("remote-id", null);
  loader.want(clock, 8, 0.1, 100);
  assert.deepEqual(asked.at(-1).window, [60, 90]);
});

test("the loader asks for less at once when there are many, and for coarser steps when it plays fast", () => {
  const { asked, loader } = watched();
  loader.look("candidate2", null);
  loader.want({ t: 500, t0: 0, t1: 1000, rate: 0 }, 250, 0.1, 0);
  const [from, to] = asked[0].window;
  assert.ok((to - from) / 0.1 * 250 <= 9001 && asked[0].step === 0.1);
  loader.forget();
  loader.want({ t: 500, t0: 0, t1: 1000, rate: 20 }, 8, 0.1, 0);
  assert.ok(Math.abs(asked[1].step - 0.5) < 1e-9 && asked[1].window[1] - asked[1].window[0] > 100);
});

test("where a stretch holds no instant, the loader asks what was before", () => {
  const { asked, instants, loader } = watched();
  const clock = { t: 65, t0: 0, t1: 80, rate: 1 };
  loader.look("candidate2", null);
  for (let now = 0; now < 50; now += 10) {
    clock.t = now < 30 ? 65 : 72;
    loader.want(clock, 8, 0.1, now, false);
    loader.answered({ id: asked.at(-1).id, done: true });
  }
  assert.deepEqual(instants.map((each) => each.at), [65, 72]);
});

test("a stretch that is still coming in is not asked for again, however slow the way", () => {
  const { asked, loader } = watched();
  const clock = { t: 65, t0: 0, t1: 1000, rate: 0 };
  loader.look("candidate2", null);
  loader.want(clock, 8, 0.1, 0);
  for (let now = 4000; now < 30_000; now += 4000) {
    loader.answered({ id: now < 9000 ? -1 : asked[0].id, done: false }, now); // first what had been asked before
    loader.want(clock, 8, 0.1, now + 3000);
  }
  assert.deepEqual(asked.map((each) => each.window), [[60, 90]]);
  loader.want(clock, 8, 0.1, 60_000);
  assert.equal(asked.length, 2, "nothing came for long: again");
});

test("a drag to somewhere else does not wait for what was asked before", () => {
  const { asked, loader } = watched();
  loader.look("candidate2", null);
  loader.want({ t: 65, t0: 0, t1: 1000, rate: 0 }, 8, 0.1, 0);
  loader.want({ t: 700, t0: 0, t1: 1000, rate: 0 }, 8, 0.1, 100);
  assert.equal(asked.length, 1);
  loader.want({ t: 700, t0: 0, t1: 1000, rate: 0 }, 8, 0.1, 200);
  assert.deepEqual(asked[1].window, [690, 720]);
});

test("the address gives back what it was made of, whatever a vehicle is called", () => {
  for (const vehicle of ["1", "<img src=x onerror=alert(1)>", "a&t=9#+%20/", "\\x1b[2J", "Ω"]) {
    assert.deepEqual(readUrl(urlOf({ t: 12.3, vehicle, definition: "snmac" })), { t: 12.3, vehicle, definition: "snmac" });
  }
  assert.deepEqual(readUrl("?t=abc"), { t: null, vehicle: null, definition: null });
  assert.equal(readUrl("?t=").t, null);
});

test("names of strangers stay on one short line", () => {
  assert.equal(format.label("a\u001b[31m\nb\u202e", 40), "a·[31m·b·");
  assert.ok(format.label("Z".repeat(500)).length <= 16);
  assert.equal(format.label("DRONE-0000000001", 12), "DRONE-…00001");
});

test("times and lengths read as people write them", () => {
  assert.equal(format.clockTime(59.96), "1:00.0");
  assert.equal(format.clockTime(3675.04), "1:01:15.0");
  assert.equal(format.clockTime(NaN), "–");
  assert.equal(format.utcTime(0), "1970-01-01 00:00:00 UTC");
  assert.equal(format.signedMetres(-1.04), "−1.0 m");
  assert.equal(format.metres(123.4), "123 m");
});

test("under another definition curve and encounters are shown together, when both are whole", () => {
  const awaited = new Awaited();
  const series = (complete, from = 0) => ({ type: "series", complete, from, step_s: 1, required_m: [20, 20] });
  const encounters = (complete) => ({ type: "encounters", complete, encounters: [] });
  assert.deepEqual(awaited.take(series(false)), [series(false)], "where nobody waits everything is shown as it comes");
  awaited.begin();
  assert.deepEqual([encounters(false), series(false), series(true)].flatMap((each) => awaited.take(each)), []);
  assert.ok(awaited.waiting);
  assert.deepEqual(awaited.take(encounters(true)), [series(true), encounters(true)]);
  assert.ok(!awaited.waiting);
  assert.equal(covered(series(false), 0, 4), 0.5);
  assert.equal(covered({ ...series(false), required_m: [] }, 0, 0), 0);
});

test("a picture holds everybody only if it holds their discs", () => {
  const frame = new Frame();
  frame.at(historyOf(instant(0, vehicle("a", 50, 80))), 0, 0);
  const view = (width) => viewOf({ width, height: 200, scale: 1, x0: 0, y0: 150, ratio: 1 });
  assert.ok(holdsDiscs(view(101), frame));
  assert.ok(!holdsDiscs(view(90), frame), "its centre is 10 px from the edge, its disc has 11.8 m");
});

test("a pair has one order, whoever was heard first", () => {
  assert.equal(format.pairLabel(["RDLK40012", "RDLK40003"], 9), "RDLK40003 · RDLK40012");
  assert.deepEqual(format.inOrder(["10/1", "9/1"]), ["9/1", "10/1"]);
});
