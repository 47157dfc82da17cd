// The plan: Leaflet carries pan and zoom in metres (x east, y north), an easel carries the picture.

import * as L from "./vendor/leaflet.js";
import { sharpness } from "./canvas.js";
import { find } from "./dom.js";
import { Easel } from "./easel.js";
import { DISPLACEMENT, E, FIELDS, N } from "./picture.js";
import { holdsDiscs, viewOf } from "./view.js";

const MARGIN_PX = 56;
const SMALLEST_M = 60;
const NEAR_PX = 22;
const VISIBLE_PX = 0.3;

export class Plan {
  #map;
  #easel;
  #fitted = false;
  #touched = false;
  #refitAt = 0;
  #stale = true;
  #drawn = NaN; // the instant that is drawn
  #painted = { names: null, trails: null }; // what the painter knows

  // onPick(name) when somebody clicks a vehicle.
  constructor(element, palette, onPick) {
    this.element = element;
    this.palette = palette;
    this.scene = { obstacles: [], goals: {}, selected: null };
    this.#map = L.map(element, {
      crs: L.CRS.Simple, attributionControl: false, zoomControl: false, keyboard: false, zoomAnimation: false,
      fadeAnimation: false, zoomSnap: 0, zoomDelta: 0.5, wheelPxPerZoomLevel: 140, wheelDebounceTime: 10,
      minZoom: -8, maxZoom: 6, center: [0, 0], zoom: 0, bounceAtZoomLimits: false, doubleClickZoom: true,
    });
    L.control.scale({ imperial: false, maxWidth: 120, position: "bottomright" }).addTo(this.#map);
    this.#easel = new Easel(element, () => this.#anew());
    this.#map.on("move zoom resize", () => { this.#stale = true; });
    this.#map.on("mousedown touchstart wheel", () => { this.#touched = true; });
    element.addEventListener("wheel", () => { this.#touched = true; }, { passive: true });
    this.#map.on("click", (event) => {
      const name = this.#hit(event.containerPoint);
      if (name !== null) onPick(name);
    });
    new ResizeObserver(() => this.#map.invalidateSize({ pan: false })).observe(element);
  }

  invalidate() { this.#stale = true; }

  get stale() { return this.#stale; }

  // Whether there is somebody to paint now.
  get free() { return this.#easel.free; }

  // Whether anybody would have moved by what an eye can see since the last drawing, if t were shown.
  visiblyElse(t) {
    const speed = (this.frame?.picture?.fastest ?? Infinity) * 2 ** this.#map.getZoom();
    return !this.frame || Math.abs(t - this.#drawn) * speed > VISIBLE_PX;
  }

  zoom(steps) {
    this.#touched = true;
    this.#map.setZoom(this.#map.getZoom() + steps);
  }

  // Show everybody, with their goals and obstacles.
  fit(frame) {
    this.#touched = false;
    const bounds = this.#bounds(frame);
    if (!bounds) return;
    const { width } = this.element.getBoundingClientRect(), legend = find("legend");
    const covered = legend.open && width > 3 * legend.offsetWidth ? legend.offsetWidth : 0;
    const paddingTopLeft = [covered + MARGIN_PX, MARGIN_PX], paddingBottomRight = [MARGIN_PX, MARGIN_PX];
    this.#map.fitBounds(bounds, { paddingTopLeft, paddingBottomRight, animate: false });
    this.#fitted = true;
  }

  // Bring a point into view if it is outside.
  reveal(north, east) {
    const at = L.latLng(north, east);
    if (!this.#map.getBounds().pad(-0.1).contains(at)) this.#map.panTo(at, { animate: false });
  }

  draw(frame, trails, now) {
    this.frame = frame;
    this.#drawn = frame.t;
    if (!this.#fitted && frame.count) this.fit(frame);
    else if (!this.#touched && now - this.#refitAt > 1000) this.#keepEverybody(frame, now);
    const values = frame.values.slice(0, frame.count * FIELDS);
    const message = { numbers: this.#numbers(), values, pairs: frame.pairs, now };
    if (this.#stale) message.look = { scene: this.scene, palette: this.palette.colours };
    if (this.#painted.names !== frame.names) message.names = frame.names;
    if (this.#painted.trails !== trails.lines) message.trails = trails.lines;
    this.#stale = false;
    this.#painted = { names: frame.names, trails: trails.lines };
    this.#easel.paint(message, [values.buffer]);
  }

  #anew() {
    this.#painted = { names: null, trails: null };
    this.#stale = true;
  }

  #numbers() {
    const { x, y } = this.#map.latLngToContainerPoint([0, 0]), size = this.#map.getSize();
    const scale = 2 ** this.#map.getZoom(); // pixels in a metre
    return { width: size.x, height: size.y, scale, x0: x, y0: y, ratio: sharpness() };
  }

  #bounds(frame) {
    const points = [];
    for (let i = 0; i < frame.count; i += 1) {
      const north = frame.value(i, N), east = frame.value(i, E), radius = frame.value(i, DISPLACEMENT) || 0;
      points.push([north - radius, east - radius], [north + radius, east + radius]);
    }
    points.push(...Object.values(this.scene.goals), ...this.scene.obstacles.flat());
    const known = points.filter(([north, east]) => Number.isFinite(north) && Number.isFinite(east));
    if (!known.length) return null;
    const bounds = L.latLngBounds(known);
    const centre = bounds.getCenter(), half = SMALLEST_M / 2;
    return bounds.extend([centre.lat - half, centre.lng - half]).extend([centre.lat + half, centre.lng + half]);
  }

  // As long as nobody has moved the plan, it follows those whose discs leave it.
  #keepEverybody(frame, now) {
    this.#refitAt = now;
    if (!holdsDiscs(viewOf(this.#numbers()), frame)) this.fit(frame);
  }

  #hit(point) {
    const { frame } = this, view = viewOf(this.#numbers());
    let best = null, nearest = NEAR_PX;
    for (let i = 0; frame && i < frame.count; i += 1) {
      const distance = Math.hypot(view.x(frame.value(i, E)) - point.x, view.y(frame.value(i, N)) - point.y);
      if (distance < nearest) [best, nearest] = [frame.names[i], distance];
    }
    return best;
  }
}
