// The mission before the start: edited on the map and in a form, checked by the station at each change, uploaded to the drones.

import { Outline, round } from "./outline.js";
import { element, say } from "./texts.js";

const AREA = "area.polygon_m";
const LAUNCHES = "drones";
const FENCE = "area.fence_margin_m";
const CHECK_MS = 300;  // after the last change
const ON_GROUND = ["preflight", "landed", ""];
const MAX_OPEN_ANSWERS = 40;

function button(text, id, look = "") {
  return Object.assign(element("button", text, look), { type: "button", id });
}

export class Editor {
  constructor(link, confirmed) {
    this.link = link;
    this.confirmed = confirmed;
    this.box = document.getElementById("editor");
    this.opener = button("", "edit");
    this.opener.setAttribute("aria-expanded", "false");
    this.opener.setAttribute("aria-controls", "editor");
    this.opener.addEventListener("click", () => (this.box.hidden ? this.#open() : this.#close()));
    this.answers = [];
    this.number = 0;
  }

  // What may be changed; nothing for an observer.
  offer(mission, map) {
    const begun = this.mission?.id !== mission.id;
    if (begun && !this.box.hidden) this.outline.remove();
    [this.mission, this.map] = [mission, map];
    if (!mission.editor) return;
    this.opener.textContent = say("edit");
    document.getElementById("commands").append(this.opener);
    if (begun && !this.box.hidden) this.#begin();
  }

  #open() {
    this.box.hidden = false;
    this.opener.setAttribute("aria-expanded", "true");
    this.#begin();
    this.map.fit(this.map.fence);
    this.box.querySelector("h2").focus();
  }

  #close() {
    this.outline.remove();
    this.box.hidden = true;
    this.opener.setAttribute("aria-expanded", "false");
    this.opener.focus();
  }

  #begin() {
    const { editor, fence } = this.mission;
    this.area = structuredClone(editor.area);
    this.launches = structuredClone(editor.launches);
    this.flaws = new Map();
    this.outline?.remove();
    this.outline = new Outline(this.map.map, this.area, this.launches, fence, (done) => this.#drawn(done), (metres) => this.#fenced(metres));
    this.#build();
    this.#changed();
  }

  #drawn(done) {
    this.#fill();
    if (done) this.#changed();
  }

  #fenced(metres) {
    this.inputs.get(FENCE)[1].value = metres;
    this.#changed();
  }

  #build() {
    const title = Object.assign(element("h2", say("editor")), { tabIndex: -1 });
    this.state = Object.assign(element("p"), { id: "draft" });
    this.state.setAttribute("role", "status");
    this.list = Object.assign(element("ul"), { id: "answers" });
    this.list.setAttribute("aria-live", "polite");
    this.inputs = new Map();
    this.send = button(say("upload"), "upload", "grave");
    this.save = button(say("download mission"), "download-mission");
    const undo = button(say("undo"), "undo");
    const close = button(say("close"), "close-editor");
    this.send.addEventListener("click", () => this.#upload());
    this.save.addEventListener("click", () => this.#download());
    undo.addEventListener("click", () => this.#begin());
    close.addEventListener("click", () => this.#close());
    const row = element("div", "", "buttons");
    row.append(this.send, this.save, undo, close);
    this.general = this.#flawOf("");
    this.box.replaceChildren(title, element("p", say("editor help")), this.state, this.general, row, this.list, this.#areaForm(), this.#launchForm(), ...this.#forms());
    this.#showAnswers();
    this.#fill();
  }

  #flawOf(key) {
    const text = Object.assign(element("p", "", "flaw"), { id: `flaw-${key}` });
    this.flaws.set(key, text);
    return text;
  }

  #group(title, key = null) {
    const set = element("fieldset");
    set.append(element("legend", title));
    if (key !== null) set.append(this.#flawOf(key));
    return set;
  }

  #areaForm() {
    const set = this.#group(say("area corners"), AREA);
    this.corners = element("ol", "", "corners");
    const add = button(say("add corner"), "add-corner");
    add.addEventListener("click", () => {
      const [[x0, y0], [x1, y1]] = [this.area.at(-1), this.area[0]];
      this.area.push([round((x0 + x1) / 2), round((y0 + y1) / 2)]);
      this.#edited();
    });
    set.append(this.corners, add);
    return set;
  }

  #launchForm() {
    const set = this.#group(say("launches"), LAUNCHES);
    this.places = element("ul", "", "corners");
    set.append(this.places);
    return set;
  }

  #forms() {
    const sets = new Map();
    for (const field of this.mission.editor.fields) {
      const section = field.key.includes(".") ? field.key.split(".")[0] : "mission";
      if (!sets.has(section)) sets.set(section, this.#group(say(`section ${section}`)));
      const row = element("div", "", "field");
      const label = Object.assign(element("label", say(`field ${field.key}`)), { htmlFor: `field-${field.key}` });
      const input = element(field.choices.length ? "select" : "input");
      if (field.choices.length) input.append(...field.choices.map((choice) => Object.assign(element("option", say(`choice ${choice}`)), { value: choice })));
      else Object.assign(input, field.number ? { type: "number", step: "any" } : { type: "text", maxLength: 200 });
      if (field.optional) input.placeholder = say("no limit");
      Object.assign(input, { id: `field-${field.key}`, value: field.value ?? "" });
      input.setAttribute("aria-describedby", `flaw-${field.key}`);
      input.addEventListener("input", () => this.#changed());
      this.inputs.set(field.key, [field, input]);
      row.append(label, input, this.#flawOf(field.key));
      sets.get(section).append(row);
    }
    return sets.values();
  }

  // The numbers beside what is drawn; an input that is being typed into stays as it is.
  #fill() {
    if (this.corners.children.length !== this.area.length) {
      this.corners.replaceChildren(...this.area.map((_, place) => this.#cornerRow(place)));
    }
    if (!this.places.children.length) this.places.append(...Object.keys(this.launches).map((name) => this.#launchRow(name)));
    for (const input of this.box.querySelectorAll(".corners input")) {
      const value = input.dataset.drone ? this.launches[input.dataset.drone][input.dataset.axis] : this.area[input.dataset.place][input.dataset.axis];
      if (input !== document.activeElement) input.value = Number(value.toFixed(2));
    }
  }

  #cornerRow(place) {
    const row = element("li");
    const remove = button(say("remove"), `remove-${place}`);
    remove.setAttribute("aria-label", say("remove corner", { corner: place + 1 }));
    remove.addEventListener("click", () => {
      if (this.area.length > 3) this.area.splice(place, 1);
      this.#edited();
    });
    row.append(...["x", "y"].map((axis, index) => this.#number(say(`corner ${axis}`, { corner: place + 1 }), axis, { place, axis: index }, (value) => (this.area[place][index] = value))), remove);
    return row;
  }

  #launchRow(name) {
    const row = element("li");
    const told = element("span", name, "name");
    row.append(told, ...["x", "y", "heading"].map((axis, index) => this.#number(say(`launch ${axis}`, { drone: name }), axis, { drone: name, axis: index }, (value) => (this.launches[name][index] = value))));
    return row;
  }

  #number(label, short, data, set) {
    const field = element("label");
    const input = Object.assign(element("input"), { type: "number", step: "any" });
    Object.assign(input.dataset, data);
    input.setAttribute("aria-label", label);
    input.addEventListener("input", () => {
      if (input.value === "" || !Number.isFinite(Number(input.value))) return;
      set(Number(input.value));
      this.outline.draw();
      this.#changed();
    });
    field.append(element("span", say(`axis ${short}`)), input);
    return field;
  }

  #edited() {
    this.outline.draw();
    this.#fill();
    this.#changed();
  }

  #draft() {
    const values = {};
    for (const [key, [field, input]] of this.inputs) {
      values[key] = field.number ? (input.value === "" ? null : Number(input.value)) : input.value;
    }
    return { area: this.area, launches: this.launches, values, number: this.number };
  }

  #changed() {
    this.number += 1;
    this.result = null;
    this.state.textContent = say("checking");
    this.#enable();
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.link.ask({ draft: this.#draft() }), CHECK_MS);
  }

  checked(result) {
    if (this.box.hidden || result.number !== this.number) return;
    this.result = result;
    for (const [key, text] of this.flaws) {
      const flaw = result.flaws.find((one) => one.field === key);
      text.textContent = flaw ? flaw.text : "";
      this.inputs.get(key)?.[1].setAttribute("aria-invalid", flaw ? "true" : "false");
    }
    this.outline.mark(result.flaws.some((flaw) => flaw.field === AREA));
    if (result.id) this.outline.fenceAt(result.fence);
    const same = result.id === this.mission.id;
    this.state.textContent = result.id ? say(same ? "same mission" : "new mission", { mission: result.id }) : say("flaws", { count: result.flaws.length });
    this.#enable();
  }

  // Only on the ground: the drones themselves refuse anything else, too.
  follow(frame) {
    this.flying = frame.drones.filter((drone) => !drone.stale && !ON_GROUND.includes(drone.stage)).map((drone) => drone.id);
    if (!this.box.hidden) this.#enable();
  }

  #enable() {
    if (!this.send) return;
    const good = Boolean(this.result?.id);
    this.save.disabled = !good;
    this.send.disabled = !good || this.flying?.length > 0;
    this.send.title = this.flying?.length ? say("in flight", { drones: this.flying.join(", ") }) : "";
    if (good && this.flying?.length) this.state.textContent = say("in flight", { drones: this.flying.join(", ") });
  }

  async #upload() {
    const { id } = this.result;
    if (!(await this.confirmed(say("confirm upload", { mission: id }), say("upload")))) return;
    this.answers = [];
    const sent = this.link.order({ draft: this.#draft(), upload: true }, (outcome) => outcome === "failed" && this.#fail(outcome));
    if (sent) this.#showAnswers();
    else this.#fail("not sent");
  }

  #fail(why) {
    this.answers.push({ values: { line: say(why, { action: say("upload") }) }, level: "warning" });
    this.#showAnswers();
  }

  #download() {
    const link = Object.assign(element("a"), {
      href: URL.createObjectURL(new Blob([this.result.file], { type: "application/toml" })), download: `mission-${this.result.id}.toml`,
    });
    link.click();
    URL.revokeObjectURL(link.href);
  }

  // What the drones have answered.
  hear(event) {
    if (event.text !== "upload") return;
    this.answers = [...this.answers, event].slice(-MAX_OPEN_ANSWERS);
    if (!this.box.hidden) this.#showAnswers();
  }

  #showAnswers() {
    this.list.replaceChildren(...this.answers.map((event) => element("li", event.values.line, event.level)));
  }
}
