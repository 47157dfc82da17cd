// The page: what a person does to it, and the loop that shows one instant at every animation frame.

import { Card } from "./card.js";
import { Clock } from "./clock.js";
import { Conversation } from "./conversation.js";
import { Definitions } from "./definitions.js";
import { find, mark, say } from "./dom.js";
import { Encounters } from "./encounters.js";
import { inOrder, KIND, label, metres, nearness, pairLabel, signedMetres } from "./format.js";
import { Frame } from "./frame.js";
import { History } from "./history.js";
import { listenToKeys, wireTabs } from "./keyboard.js";
import { LinkHealth } from "./link.js";
import { Loader } from "./loader.js";
import { Palette } from "./palette.js";
import { E, N } from "./picture.js";
import { Plan } from "./plan.js";
import { publish } from "./publish.js";
import { Strip } from "./strip.js";
import { Trails } from "./trails.js";
import { Transport } from "./transport.js";
import { readUrl, UrlKeeper } from "./url.js";
import { Vehicles } from "./vehicles.js";

const NOBODY = {
  demo: "Nobody is in the air yet: the demo is starting. The first time, its solver is compiled: up to half a minute.", air: "Nobody is heard on the air.",
  link: "Nobody is heard on this link.", file: "Nobody is in the air at this instant.",
};
const PLAYHEAD_EVERY_MS = 40;
// What changes beside the plan: so often, and at most one of them in a frame, so that no frame is a long one.
const CHORES = [["figures", 100], ["curve", 250], ["tables", 400]];

class Page {
  hello = null;
  live = false;
  definition = null;
  selected = null;
  chooses = true; // until somebody deselects, the page selects a vehicle itself
  asked = readUrl();
  dirty = true;
  known = false; // whether the history holds the instant of the clock
  changes = 0;
  playheadAt = 0;
  doneAt = { figures: 0, curve: 0, tables: 0 };

  constructor() {
    this.history = new History();
    this.frame = new Frame();
    this.trails = new Trails();
    this.urls = new UrlKeeper();
    this.palette = new Palette(() => this.restyle());
    this.clock = new Clock(() => this.tempo());
    this.loader = new Loader((request) => this.conversation.send(request));
    this.plan = new Plan(find("map"), this.palette, (name) => this.select(name));
    this.strip = new Strip(find("strip"), this.palette, (t, encounter) => this.jump(t, encounter));
    this.transport = new Transport(this.clock);
    this.encounters = new Encounters((encounter) => this.jump(encounter.closest_t, encounter));
    this.vehicles = new Vehicles((name) => this.select(name));
    this.card = new Card(this.palette);
    this.link = new LinkHealth();
    this.definitions = new Definitions((name) => this.define(name));
    this.wire();
    this.conversation = new Conversation(this);
    requestAnimationFrame((now) => this.tick(now));
  }

  wire() {
    const { clock, plan, transport } = this;
    find("zoom-in").addEventListener("click", () => plan.zoom(0.5));
    find("zoom-out").addEventListener("click", () => plan.zoom(-0.5));
    find("fit").addEventListener("click", () => plan.fit(this.frame));
    find("theme").addEventListener("click", () => this.palette.toggle());
    find("help-open").addEventListener("click", () => find("help").showModal());
    find("legend").open = innerWidth > 1180 && innerHeight > 700;
    wireTabs(document.querySelector('[role="tablist"]'));
    const step = (seconds) => () => this.step(seconds);
    listenToKeys({
      " ": () => transport.toggle(), b: () => transport.backwards(),
      ArrowLeft: step(-1), ArrowRight: step(1), "Shift+ArrowLeft": step(-10), "Shift+ArrowRight": step(10),
      ",": step(-0.1), ".": step(0.1),
      ArrowUp: () => transport.faster(1), ArrowDown: () => transport.faster(-1),
      Home: () => clock.seek(clock.t0), End: () => (this.live ? clock.follow() : clock.seek(clock.t1)),
      f: () => { if (this.live) clock.follow(); },
      n: () => this.jumpBeside(1), p: () => this.jumpBeside(-1),
      "[": () => this.selectBeside(-1), "]": () => this.selectBeside(1), Escape: () => this.select(null),
      "+": () => plan.zoom(0.5), "=": () => plan.zoom(0.5), "-": () => plan.zoom(-0.5), z: () => plan.fit(this.frame),
      g: () => { find("legend").open = !find("legend").open; },
      l: () => this.palette.toggle(), "?": () => find("help").showModal(),
      ...Object.fromEntries([1, 2, 3, 4, 5, 6].map((digit) => [digit, () => this.define(this.definitions.names[digit - 1])])),
    });
  }

  // Somebody has changed how time goes on.
  tempo() {
    this.dirty = true;
    this.conversation?.follow(this.clock.following);
  }

  define(name) {
    if (!name || name === this.definition) return;
    this.definition = name;
    this.definitions.choose(name);
    this.frame.growFromHere(performance.now());
    this.loader.look(name, this.selected);
    const { title } = this.hello.definitions.find((each) => each.name === name);
    this.conversation.judgeBy(name);
    say(find("say"), `Definition: ${title}`);
  }

  select(name) {
    this.chooses = false;
    if (name === this.selected) return;
    this.selected = name;
    this.plan.scene.selected = name;
    this.plan.invalidate();
    this.loader.look(this.definition, name);
    this.conversation.send({ select: name });
    this.dirty = true;
    say(find("say"), name === null ? "No vehicle selected" : `Selected: ${label(name, 40)}`);
  }

  selectBeside(step) {
    const names = inOrder(this.frame.names);
    if (!names.length) return;
    const at = names.indexOf(this.selected);
    this.select(names[at < 0 ? 0 : (at + step + names.length) % names.length]);
  }

  step(seconds) {
    this.clock.rate = 0;
    this.clock.seek(this.clock.t + seconds);
  }

  jump(t, encounter) {
    this.clock.rate = 0;
    this.clock.seek(t);
    this.encounters.choose(encounter?.id ?? null);
    if (encounter && !encounter.pair.includes(this.selected)) this.select(encounter.pair[0]);
    this.reveals = encounter !== null;
  }

  jumpBeside(direction) {
    const encounter = this.encounters.beside(this.clock.t, direction);
    if (encounter) this.jump(encounter.closest_t, encounter);
  }

  restyle() {
    this.plan?.invalidate();
    this.strip?.restyle();
    this.doneAt.curve = 0;
    this.dirty = true;
  }

  tick(now) {
    requestAnimationFrame((next) => this.tick(next));
    if (!this.hello) return;
    const { clock, frame, plan } = this;
    clock.tick(now, this.live, !this.known && this.loader.waiting);
    if (!clock.following) this.want(now);
    const other = this.dirty || frame.isOther(this.history, clock.t) || plan.visiblyElse(clock.t);
    const due = plan.free && (other || plan.stale || frame.growing);
    if (due) {
      this.known = frame.at(this.history, clock.t, now, !clock.following && this.loader.complete);
      this.dirty = !this.known;
      if (this.known || plan.stale) {
        this.trails.update(this.history, clock.t, this.changes, frame.names);
        plan.draw(frame, this.trails, now);
        this.reveal();
      }
    }
    if (now - this.playheadAt >= PLAYHEAD_EVERY_MS) {
      this.playheadAt = now;
      this.strip.point(clock.t);
    }
    const overdue = ([name, every]) => (now - this.doneAt[name]) / every;
    const most = CHORES.reduce((one, other) => (overdue(other) > overdue(one) ? other : one));
    if (overdue(most) < 1) return;
    this.doneAt[most[0]] = now;
    this[most[0]](now);
  }

  want(now) {
    const crowd = Math.max(this.frame.count, this.history.crowd);
    this.loader.want(this.clock, crowd, this.hello.step_s ?? 0.1, now, this.known);
  }

  // After a jump to an encounter, its vehicle is in view.
  reveal() {
    const index = this.reveals ? this.frame.index(this.selected) : -1;
    if (index < 0) return;
    this.reveals = false;
    this.plan.reveal(this.frame.value(index, N), this.frame.value(index, E));
  }

  curve() { this.strip.draw(this.clock); }

  figures() {
    const { frame } = this;
    this.transport.draw(this.strip.range, this.live, this.hello.utc0 ?? null);
    if (this.chooses && frame.count && frame.index(this.selected) < 0) {
      this.select(inOrder(frame.names)[0]);
      this.chooses = true; // and another one, should this one go or get another name
    }
    const loading = !this.known && this.loader.waiting;
    find("plan-empty").hidden = frame.count > 0;
    say(find("plan-empty"), loading ? "Loading …" : NOBODY[this.hello.source] ?? NOBODY.link);
    mark(find("clock"), "loading", String(loading));
    const [one, other, distance, required] = frame.tightest ?? [-1, -1, NaN, NaN];
    const kind = frame.tightest ? KIND[nearness(distance, required)] : "";
    say(find("tightest"), metres(distance));
    say(find("tightest-pair"), frame.tightest ? pairLabel([frame.names[one], frame.names[other]], 9) : "");
    say(find("required"), metres(required));
    say(find("margin"), signedMetres(distance - required));
    mark(find("margin"), "kind", kind);
    this.card.draw(frame, this.selected);
    publish(find("map").dataset, frame, this.clock, this.selected);
  }

  tables(now) {
    this.vehicles.draw(this.frame, this.selected);
    const t = this.clock.following ? null : this.clock.t;
    this.urls.keep({ t, vehicle: this.selected, definition: this.definition }, now);
  }

}

new Page();
