// The operator's commands: start, land and abort are confirmed; hold and return act at once, also by the keys H and R.

import { element, say } from "./texts.js";

const CONFIRMED = ["start", "land", "abort"];
const KEYS = { h: "hold", r: "return" };

export class Commands {
  constructor(ask) {
    this.ask = ask;
    this.bar = document.getElementById("commands");
    this.dialog = document.getElementById("confirm");
    this.offered = [];
    document.addEventListener("keydown", (press) => this.#pressed(press));
  }

  // Show what this station may do; nothing for an observer.
  offer(mission) {
    this.offered = mission.commands;
    this.bar.hidden = !this.offered.length;
    const buttons = this.offered.map((action) => {
      const look = CONFIRMED.includes(action) ? "grave" : action === "hold" ? "stop" : "";
      const button = Object.assign(element("button", say(`command ${action}`), look), { type: "button", id: `command-${action}` });
      button.addEventListener("click", () => this.#give(action));
      return button;
    });
    this.ticks = mission.drones.map((drone) => Object.assign(element("input"), { type: "checkbox", checked: true, value: drone, id: `to-${drone}` }));
    const labels = this.ticks.map((tick) => {
      const label = element("label");
      label.append(tick, element("span", tick.value));
      return label;
    });
    this.bar.replaceChildren(...buttons, element("span", say("addressed")), ...labels);
  }

  #pressed(press) {
    const typing = ["INPUT", "SELECT", "TEXTAREA"].includes(press.target.tagName) && press.target.type !== "checkbox" && press.target.type !== "range";
    const action = KEYS[press.key.toLowerCase()];
    if (action && this.offered.includes(action) && !typing && !press.ctrlKey && !press.metaKey && !press.altKey && !press.repeat) this.#give(action);
  }

  async #give(action) {
    const ticked = this.ticks.filter((tick) => tick.checked).map((tick) => tick.value);
    if (!ticked.length) return;
    const all = ticked.length === this.ticks.length;
    const question = say(`confirm ${action}`, { drones: all ? say("all") : ticked.join(", ") });
    if (CONFIRMED.includes(action) && !(await this.confirmed(question, say(`command ${action}`)))) return;
    this.ask({ command: action, drones: all ? [] : ticked });
  }

  // Whether a question is answered with yes.
  confirmed(question, yes) {
    document.getElementById("confirm-text").textContent = question;
    document.getElementById("confirm-yes").textContent = yes;
    this.dialog.returnValue = "no";
    this.dialog.showModal();
    return new Promise((resolve) => {
      this.dialog.addEventListener("close", () => resolve(this.dialog.returnValue === "yes"), { once: true });
    });
  }
}
