// Keys. What a control does with a key itself is left to it.

const OWN_KEYS = {
  radio: ["ArrowLeft", "ArrowRight", "ArrowUp", "ArrowDown", " "],
  "select-one": ["ArrowUp", "ArrowDown", "ArrowLeft", "ArrowRight", " ", "Home", "End", "Enter"],
  button: [" ", "Enter"],
};

export function listenToKeys(actions) {
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || document.querySelector("dialog[open]")) return;
    const own = OWN_KEYS[event.target.type] ?? (event.target.tagName === "SUMMARY" ? OWN_KEYS.button : []);
    if (own.includes(event.key) || event.target.role === "tab") return;
    const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
    const action = actions[event.shiftKey ? `Shift+${key}` : key] ?? actions[key];
    if (!action) return;
    event.preventDefault();
    action(event.key);
  });
}

// Arrow keys go from tab to tab; only the chosen one is in the tab order.
export function wireTabs(list) {
  const tabs = [...list.querySelectorAll('[role="tab"]')];
  const choose = (chosen) => {
    for (const tab of tabs) {
      const on = tab === chosen;
      tab.setAttribute("aria-selected", String(on));
      tab.tabIndex = on ? 0 : -1;
      document.getElementById(tab.getAttribute("aria-controls")).hidden = !on;
    }
  };
  tabs.forEach((tab, i) => {
    tab.addEventListener("click", () => choose(tab));
    tab.addEventListener("keydown", (event) => {
      const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
      if (!step) return;
      const next = tabs[(i + step + tabs.length) % tabs.length];
      choose(next);
      next.focus();
    });
  });
}
