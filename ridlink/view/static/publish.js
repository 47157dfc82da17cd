// What is shown, as data attributes, for whoever reads the document: tests, extensions.

import { AIRFRAME, DISPLACEMENT, E, ERROR, N } from "./picture.js";

export function publish(dataset, frame, clock, selected) {
  const index = frame.index(selected);
  const of = (...fields) => (index < 0 ? "" : fields.map((field) => frame.value(index, field).toFixed(2)).join(","));
  Object.assign(dataset, {
    t: clock.t.toFixed(2), shown: frame.t.toFixed(2), vehicles: String(frame.count), selected: selected ?? "",
    definition: frame.picture?.definition ?? "", following: String(clock.following),
    position: of(N, E), rings: of(AIRFRAME, ERROR, DISPLACEMENT),
  });
}
