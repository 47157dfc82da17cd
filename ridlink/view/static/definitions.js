// The chooser of the separation definition: whose discs are drawn, and what is too near.

import { find } from "./dom.js";

// "Candidate 2: reported error and airframe" is a name and what it means.
function split(title) {
  const [name, ...rest] = title.split(": ");
  return [name, rest.join(": ")];
}

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
      [text.textContent] = split(title);
      label.title = `${title} (${i + 1})`;
      label.append(input, text);
      this.field.append(label);
      return input;
    });
    this.#explain(definitions);
    this.choose(chosen);
  }

  choose(name) {
    for (const input of this.#inputs) {
      input.checked = input.value === name;
      if (!input.checked) continue;
      const { offsetLeft, offsetWidth } = input.parentElement;
      this.field.scrollLeft = offsetLeft + offsetWidth / 2 - this.field.clientWidth / 2;
    }
  }

  // In the help.
  #explain(definitions) {
    const rows = definitions.map(({ title }) => {
      const row = document.createElement("div"), term = document.createElement("dt"), meaning = document.createElement("dd");
      [term.textContent, meaning.textContent] = split(title);
      row.append(term, meaning);
      return row;
    });
    find("help-definitions").replaceChildren(...rows);
  }
}
