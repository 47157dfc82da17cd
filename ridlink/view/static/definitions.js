// The chooser of the separation definition: whose discs are drawn, and what is too near.

import { find } from "./dom.js";

export class Definitions {
  #inputs = [];

  constructor(onChoose) {
    this.field = find("definitions");
    this.onChoose = onChoose;
  }

  get names() { return this.#inputs.map((input) => input.value); }

  show(definitions, chosen) {
    for (const label of this.field.querySelectorAll("label")) label.remove();
    this.#inputs = definitions.map(({ name, title }, i) => {
      const label = document.createElement("label"), input = document.createElement("input");
      const text = document.createElement("span");
      Object.assign(input, { type: "radio", name: "definition", value: name });
      input.addEventListener("change", () => this.onChoose(name));
      text.textContent = title;
      label.title = `${title} (${i + 1})`;
      label.append(input, text);
      this.field.append(label);
      return input;
    });
    this.choose(chosen);
  }

  choose(name) {
    for (const input of this.#inputs) {
      input.checked = input.value === name;
      if (input.checked) input.parentElement.scrollIntoView?.({ block: "nearest", inline: "nearest" });
    }
  }
}
