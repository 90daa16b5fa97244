// The page's words, from texts.en.json; markup never comes from a message.

let texts = {};

export async function loadTexts() {
  texts = await (await fetch("texts.en.json")).json();
  for (const element of document.querySelectorAll("[data-text]")) element.textContent = say(element.dataset.text);
  for (const element of document.querySelectorAll("[data-label]")) element.setAttribute("aria-label", say(element.dataset.label));
}

export function say(key, values = {}) {
  const text = texts[key] ?? key;
  return text.replace(/\{(\w+)\}/g, (_, name) => (name in values ? String(values[name]) : ""));
}

export function element(kind, text = "", className = "") {
  const made = document.createElement(kind);
  made.textContent = text;
  if (className) made.className = className;
  return made;
}

const PREFIXES = [[1e12, "TBq"], [1e9, "GBq"], [1e6, "MBq"], [1e3, "kBq"]];

// An activity, with its uncertainty in the same unit where one is given.
export function becquerel(value, sigma = null) {
  const [unit, name] = PREFIXES.find(([unit]) => value >= unit) ?? [1, "Bq"];
  const text = significant(value / unit);
  const decimals = text.split(".")[1]?.length ?? 0;
  return sigma === null ? `${text} ${name}` : `${text} ± ${(sigma / unit).toFixed(decimals)} ${name}`;
}

export function significant(value) {
  if (value === 0) return "0";
  const digits = Math.max(0, 2 - Math.floor(Math.log10(Math.abs(value))));
  return digits > 6 ? value.toExponential(1) : value.toFixed(digits);
}

// A time in the flight as minutes and seconds, with hours where there are any.
export function duration(ms) {
  const seconds = Math.max(0, Math.round(ms / 1000));
  const two = (value) => String(value).padStart(2, "0");
  const [hours, minutes] = [Math.floor(seconds / 3600), Math.floor(seconds / 60) % 60];
  return hours ? `${hours}:${two(minutes)}:${two(seconds % 60)}` : `${minutes}:${two(seconds % 60)}`;
}

export function clock(ms) {
  return new Date(ms).toISOString().slice(11, 19);
}

const COLOURS = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#8c6d00", "#555555"];

export function colour(index) {
  return COLOURS[index % COLOURS.length];
}
