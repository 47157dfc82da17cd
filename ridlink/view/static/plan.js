// The plan: Leaflet carries pan and zoom in metres (x east, y north), two canvases carry the picture.

import * as L from "./vendor/leaflet.js";
import { canvasIn, prepare } from "./canvas.js";
import { find } from "./dom.js";
import { drawGround } from "./ground.js";
import { DISPLACEMENT, E, FIELDS, N } from "./picture.js";
import { drawTraffic } from "./traffic.js";

const MARGIN_PX = 56;
const SMALLEST_M = 60;
const NEAR_PX = 22;
const VISIBLE_PX = 0.3;

export class Plan {
  #map;
  #ground;
  #traffic;
  #fitted = false;
  #touched = false;
  #refitAt = 0;
  #stale = true;
  #drawn = NaN; // the instant that is drawn

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
    this.#ground = canvasIn(element, "ground");
    this.#traffic = canvasIn(element, "traffic");
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

  draw(frame, trails, labels, now) {
    this.frame = frame;
    this.#drawn = frame.t;
    if (!this.#fitted && frame.count) this.fit(frame);
    else if (!this.#touched && now - this.#refitAt > 1000) this.#keepEverybody(frame, now);
    const view = this.#view();
    if (this.#stale) {
      drawGround(prepare(this.#ground, view), view, this.scene, this.palette);
      this.#stale = false;
    }
    labels.place(frame, view, this.scene.selected, now);
    drawTraffic(prepare(this.#traffic, view), view, { frame, trails, labels, ...this.scene }, this.palette);
  }

  #view() {
    const origin = this.#map.latLngToContainerPoint([0, 0]), size = this.#map.getSize();
    const scale = 2 ** this.#map.getZoom(); // pixels in a metre
    return {
      width: size.x, height: size.y, scale,
      x: (east) => origin.x + east * scale,
      y: (north) => origin.y - north * scale,
      north: (y) => (origin.y - y) / scale,
      east: (x) => (x - origin.x) / scale,
    };
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

  // As long as nobody has moved the plan, it follows those who fly out of it.
  #keepEverybody(frame, now) {
    this.#refitAt = now;
    const shown = this.#map.getBounds();
    for (let a = 0; a < frame.count * FIELDS; a += FIELDS) {
      if (!shown.contains([frame.values[a + N], frame.values[a + E]])) {
        this.fit(frame);
        return;
      }
    }
  }

  #hit(point) {
    const { frame } = this, view = this.#view();
    let best = null, nearest = NEAR_PX;
    for (let i = 0; frame && i < frame.count; i += 1) {
      const distance = Math.hypot(view.x(frame.value(i, E)) - point.x, view.y(frame.value(i, N)) - point.y);
      if (distance < nearest) [best, nearest] = [frame.names[i], distance];
    }
    return best;
  }
}
