// What the server says, and what becomes of it: the greeting, instants, the curve, encounters, the health of the link.

import { Awaited, covered } from "./awaited.js";
import { find, mark, say } from "./dom.js";
import { label } from "./format.js";
import { pack } from "./picture.js";
import { Socket } from "./socket.js";
import { TRAIL_S, TRAIL_STEP_S } from "./trails.js";

const AGAIN_MS = 300;

export class Conversation {
  #curveAt = -Infinity; // when the curve was asked for again, because it had become long
  #awaited = new Awaited();
  #asksAgain = null; // for a curve that was not whole
  #pushed = null; // the greeting and whether pushes were asked for since

  constructor(page) {
    this.page = page;
    const address = new URL("ws/v1", location.href);
    address.protocol = location.protocol === "https:" ? "wss:" : "ws:";
    address.search = "";
    this.socket = new Socket(address.href, (message) => this.receive(message), (state) => this.#connection(state));
  }

  send(request) { return this.socket.send(request); }

  askSeries() {
    const { clock } = this.page;
    this.send({ series: [clock.t0, clock.t1] });
  }

  // Everything under another definition; until its history has been read, what stood there before stays, greyed.
  judgeBy(definition) {
    this.#awaited.begin();
    this.send({ definition });
    this.askSeries();
    this.#showWaiting(0);
  }

  // Whether the server shall push; told when it changes.
  follow(following) {
    const { hello } = this.page;
    if (!hello || (this.#pushed?.hello === hello && this.#pushed.following === following)) return;
    if (this.send({ follow: following })) this.#pushed = { hello, following };
  }

  receive(message) {
    const { page } = this;
    const current = message.definition === page.definition;
    switch (message.type) {
      case "hello": return this.#greet(message);
      case "instant": return this.#take(message);
      case "instants": return this.#takeMany(message);
      case "series":
      case "encounters":
        return current ? this.#judged(message) : undefined;
      case "health":
        this.#extent(message);
        return page.link.draw(message, page.hello?.source === "file");
      case "error": return console.warn("ridlink:", message.message);
      default: return undefined;
    }
  }

  // Curve or encounters under the definition that is looked at.
  #judged(message) {
    const { page } = this, { waiting } = this.#awaited;
    for (const each of this.#awaited.take(message)) {
      if (each.type === "series") page.strip.replace(each);
      else {
        page.encounters.replace(each.encounters, each.complete !== false);
        page.strip.mark(page.encounters.list);
      }
    }
    if (waiting && !this.#awaited.waiting && page.live) this.askSeries(); // for what came while it waited
    if (message.type !== "series") {
      if (waiting && !this.#awaited.waiting) this.#showWaiting(1);
      return;
    }
    clearTimeout(this.#asksAgain);
    if (message.complete === false) this.#asksAgain = setTimeout(() => this.askSeries(), AGAIN_MS);
    const { t0, t1 } = page.clock;
    this.#showWaiting(message.complete === false ? covered(message, t0, t1) : 1);
  }

  // That curve and encounters are being worked out, if they are, and how far that is.
  #showWaiting(share) {
    const { page } = this, note = find("working");
    const title = page.hello.definitions.find((each) => each.name === page.definition)?.title ?? page.definition;
    note.hidden = share >= 1 && !this.#awaited.waiting;
    say(note, `Working out ${title.split(": ")[0]} … ${Math.floor(100 * Math.min(share, 0.99))} %`);
    for (const id of ["strip", "encounters", "no-encounters"]) mark(find(id), "waiting", String(this.#awaited.waiting));
  }

  #connection(state) {
    if (state !== "open") this.page.link.state(state);
  }

  // A source begins, or begins anew.
  #greet(hello) {
    const { page } = this, again = page.hello !== null;
    page.hello = hello;
    for (const each of [page.history, page.strip]) each.clear();
    page.loader.forget();
    page.clock.reset();
    this.#awaited.end();
    this.#curveAt = -Infinity;
    this.#extent(hello);
    const wanted = again ? page.definition : page.asked.definition;
    page.definition = hello.definitions.some((each) => each.name === wanted) ? wanted : hello.definition;
    page.definitions.show(hello.definitions, page.definition);
    if (!again) page.selected = page.asked.vehicle;
    page.chooses &&= again || page.selected === null;
    page.loader.look(page.definition, page.selected);
    const { obstacles = [], goals = {} } = hello;
    Object.assign(page.plan.scene, { obstacles, goals, selected: page.selected });
    page.plan.invalidate();
    say(find("title"), label(hello.title ?? "", 60));
    find("title").title = label(hello.title ?? "", 200);
    document.title = `${label(hello.title ?? "", 40)} – ridlink`;
    for (const entry of document.querySelectorAll("[data-truth]")) entry.hidden = !hello.truth;
    find("legend-goal").hidden = !Object.keys(goals).length;
    find("legend-obstacle").hidden = !obstacles.length;
    this.send({ definition: page.definition });
    if (page.selected !== null) this.send({ select: page.selected });
    this.askSeries();
    this.#begin(again);
  }

  // Where the address says, else live, else from the beginning.
  #begin(again) {
    const { clock, asked, live } = this.page;
    if (again && !clock.following) clock.seek(clock.t);
    else if (!again && asked.t !== null) clock.seek(asked.t);
    else if (live) this.#followWithTrail();
    else {
      clock.seek(clock.t0);
      clock.play(1);
    }
    this.follow(clock.following);
  }

  // Who comes late sees where everybody came from, too.
  #followWithTrail() {
    const { clock } = this.page;
    clock.follow();
    this.send({ window: [Math.max(clock.t0, clock.t1 - TRAIL_S), clock.t1], id: 0, step: TRAIL_STEP_S });
  }

  #take(message) {
    const { page } = this;
    this.#extent(message);
    const picture = pack(message, message.definition);
    this.#keep(picture);
    if (!page.clock.following) return;
    page.clock.arrived(picture.t, performance.now());
    if (picture.definition !== page.definition) return;
    if (!this.#awaited.waiting) page.strip.append(picture.t, picture.tightest);
    if (page.strip.overfull && picture.t - this.#curveAt > 10) {
      this.#curveAt = picture.t;
      this.askSeries();
    }
  }

  #takeMany(message) {
    const { page } = this;
    for (const instant of message.instants) this.#keep(pack(instant, message.definition));
    const stretch = page.loader.answered(message, performance.now());
    if (stretch) page.history.purge(stretch.from, stretch.to, page.definition);
    page.changes += 1;
  }

  #keep(picture) {
    const { history, clock, loader } = this.page;
    if (history.add(picture, clock.t)) loader.forgetBeyond(history.first, history.last);
    this.page.dirty = true;
  }

  #extent({ t0, t1, live }) {
    const { page } = this;
    page.clock.extent(t0, t1);
    if (typeof live !== "boolean") return;
    const ended = page.live && !live;
    page.live = live;
    if (ended && page.clock.following) page.clock.pause();
    page.link.state(live ? "live" : page.hello?.source === "file" ? "recorded" : "ended");
  }
}
