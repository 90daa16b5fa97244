// The operator's commands: start, land and abort are confirmed; hold and return act at once, also by the keys H and R. What became
// of the last one stands beside the buttons.

import { clock, element, say } from "./texts.js";

const CONFIRMED = ["start", "land", "abort"];
const KEYS = { h: "hold", r: "return" };
const TOLD = ["command", "upload"];  // events
const MOST_TICKS = 6;  // that are always in sight

export class Commands {
  constructor(link) {
    this.link = link;
    this.bar = document.getElementById("commands");
    this.dialog = document.getElementById("confirm");
    this.offered = [];
    this.ticks = [];
    this.last = element("p");
    this.last.id = "told";
    document.addEventListener("keydown", (press) => this.#pressed(press));
  }

  // Show what this station may do; nothing for an observer. Whom the operator has chosen stays chosen when the link comes back.
  offer(mission) {
    const left = new Set(this.ticks.filter((tick) => !tick.checked).map((tick) => tick.value));
    this.offered = mission.commands;
    this.bar.hidden = !this.offered.length;
    const buttons = this.offered.map((action) => {
      const look = CONFIRMED.includes(action) ? "grave" : action === "hold" ? "stop" : "";
      const button = Object.assign(element("button", say(`command ${action}`), look), { type: "button", id: `command-${action}` });
      button.addEventListener("click", () => this.#give(action));
      return button;
    });
    this.ticks = mission.drones.map((drone) => Object.assign(element("input"), { type: "checkbox", checked: !left.has(drone), value: drone, id: `to-${drone}` }));
    this.bar.replaceChildren(...buttons, ...this.#addressees(), this.last);
    this.#showChosen();
  }

  // A tick for each drone; of many drones they are folded away.
  #addressees() {
    const labels = this.ticks.map((tick) => {
      const label = element("label");
      label.append(tick, element("span", tick.value));
      tick.addEventListener("change", () => this.#showChosen());
      return label;
    });
    if (labels.length <= MOST_TICKS) return [element("span", say("addressed")), ...labels];
    const box = Object.assign(element("details"), { id: "addressees" });
    const all = ["all", "none"].map((name) => {
      const button = Object.assign(element("button", say(`choose ${name}`)), { type: "button", id: `choose-${name}` });
      button.addEventListener("click", () => this.#choose(name === "all"));
      return button;
    });
    const inside = element("div");
    inside.append(...all, ...labels);
    this.chosen = element("summary");
    box.append(this.chosen, inside);
    return [box];
  }

  #choose(on) {
    for (const tick of this.ticks) tick.checked = on;
    this.#showChosen();
  }

  #showChosen() {
    if (!this.chosen) return;
    const [number, most] = [this.ticks.filter((tick) => tick.checked).length, this.ticks.length];
    this.chosen.textContent = number === most ? say("addressed all", { most }) : say("addressed some", { number, most });
  }

  // What became of a command or an upload.
  hear(event) {
    if (TOLD.includes(event.text)) this.#tell(`${clock(event.at_ms)} ${event.values.line}`, event.level === "warning");
  }

  #tell(text, warning) {
    Object.assign(this.last, { textContent: text, className: warning ? "warning" : "" });
  }

  #pressed(press) {
    const typing = ["INPUT", "SELECT", "TEXTAREA"].includes(press.target.tagName) && press.target.type !== "checkbox" && press.target.type !== "range";
    const action = KEYS[press.key.toLowerCase()];
    if (action && this.offered.includes(action) && !typing && !press.ctrlKey && !press.metaKey && !press.altKey && !press.repeat) this.#give(action);
  }

  async #give(action) {
    const ticked = this.ticks.filter((tick) => tick.checked).map((tick) => tick.value);
    if (!ticked.length) {
      this.#tell(say("nobody chosen", { action: say(`command ${action}`) }), true);
      return;
    }
    const all = ticked.length === this.ticks.length;
    const question = say(`confirm ${action}`, { drones: all ? say("all") : ticked.join(", ") });
    if (CONFIRMED.includes(action) && !(await this.confirmed(question, say(`command ${action}`)))) return;
    const name = { action: say(`command ${action}`) };
    const sent = this.link.order({ command: action, drones: all ? [] : ticked }, (outcome) => this.#became(outcome, name));
    this.#tell(say(sent ? "on its way" : "not sent", name), !sent);
  }

  // What the station says of a command; why it refuses one comes as an event, as what the drones made of it does.
  #became(outcome, name) {
    const isNewest = this.last.textContent === say("on its way", name);
    if (outcome === "failed" || outcome === "late" || (outcome === "sent" && isNewest)) this.#tell(say(outcome, name), outcome !== "sent");
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
