// The panel beside the map: source, drones, timeline.

import { spectrumOf } from "./charts.js";
import { becquerel, clock, colour, element, say, significant } from "./texts.js";

const MAX_EVENTS = 200;

export function showSource(frame) {
  const box = document.getElementById("source");
  const { source, others, search } = frame;
  const sources = source ? [source, ...others] : [];
  const titled = sources.map((one) => (others.length ? [say("source number", one), ...sourceLines(one)] : sourceLines(one)));
  const blocks = source ? [...titled, ...(search ? [furtherLines(search)] : [])] : [searchLines(search, frame.finding)];
  box.replaceChildren(...blocks.flatMap((lines) => lines.map((text, place) => element("p", text, place === 0 ? "what" : ""))));
}

function sourceLines(source) {
  const [x, y, z] = source.place.map((value) => value.toFixed(2));
  const speed = Math.hypot(...source.velocity_mps);
  const bearing = ((90 - (180 / Math.PI) * Math.atan2(source.velocity_mps[1], source.velocity_mps[0]) + 360) % 360).toFixed(0);
  const known = source.activity_bq !== null;
  return [
    known ? say("activity", { nuclide: source.nuclide, activity: becquerel(source.activity_bq, source.activity_sigma_bq) }) : source.nuclide,
    ...(source.dose_usvph === null ? [] : [say("dose", { dose: significant(source.dose_usvph) })]),
    say("position", { x, y, z }),
    ...(source.position_deg === null ? [] : [say("geodetic", degrees(source.position_deg))]),
    ...(source.bearing_deg === null ? [] : [say("outside", { bearing: (Math.round(source.bearing_deg) % 360).toFixed(0).padStart(3, "0") })]),
    say("region", { long: significant(source.region[0]), short: significant(source.region[1]) }),
    speed < 0.05 ? say("at rest") : say("velocity", { speed: speed.toFixed(2), bearing }),
    say("cones", { cones: source.cones }),
  ];
}

function degrees([latitude, longitude]) {
  return {
    latitude: `${Math.abs(latitude).toFixed(6)}° ${latitude < 0 ? "S" : "N"}`,
    longitude: `${Math.abs(longitude).toFixed(6)}° ${longitude < 0 ? "W" : "E"}`,
  };
}

function searchLines(search, finding) {
  const lines = [finding ? say("finding", { finding }) : say("no source")];
  if (search) {
    lines.push(say("none", { percent: (100 * search.none).toFixed(0) }));
    if (search.nuclides_bq) lines.push(...excludedLines(search));
    else if (search.excluded_bq !== null) lines.push(say("excluded", { activity: becquerel(search.excluded_bq) }));
  }
  return lines;
}

function furtherLines(search) {
  return [say("further"), ...excludedLines(search)];
}

// Of a search for several sources: what is excluded of each nuclide, and of which parts of the area that does not hold.
function excludedLines({ nuclides_bq, left, glare }) {
  const nuclides = Object.entries(nuclides_bq).map(([nuclide, limit]) => `${nuclide} ${becquerel(limit)}`).join(", ");
  const percent = (share) => ({ percent: (100 * share).toFixed(0) });
  return [
    nuclides ? say("excluded nuclides", { nuclides }) : say("nothing excluded"),
    ...(left ? [say("left", percent(left))] : []),
    ...(glare ? [say("glare", percent(glare))] : []),
  ];
}

export function showDrones({ drones, source, warnings, warning_codes, revoked }) {
  const withdrawn = revoked.map((member) => element("div", say("revoked", { member }), "problem"));
  showSwarm(drones, [...withdrawn, ...coded(warnings, warning_codes, "problem")]);
  const far = source ? Math.max(0.5, 3 * source.rms_m) : 0;
  document.getElementById("drones").replaceChildren(...drones.map((drone, index) => droneItem(drone, index, far)));
}

// How many are heard and well, and what the station itself warns of.
function showSwarm(drones, warnings) {
  const named = (key, some) => (some.length ? [say(key, { number: some.length, drones: some.map(({ id }) => id).join(", ") })] : []);
  const silent = drones.filter((drone) => drone.stale);
  const parts = [say("swarm", { heard: drones.length - silent.length, all: drones.length }), ...named("silent drones", silent),
    ...named("drones with problems", drones.filter((drone) => !drone.stale && drone.problems.length))];
  const box = document.getElementById("swarm");
  box.replaceChildren(element("span", parts.join(" · "), parts.length > 1 ? "problem" : "dim"), ...warnings);
}

function droneItem(drone, index, far) {
  const item = element("li", "", drone.stale ? "stale" : "");
  item.id = `drone-${drone.id}`;
  item.style.borderColor = colour(index);
  const head = element("div");
  head.append(element("span", drone.id, "name"), element("span", ` ${say("drone line", {
    stage: drone.stage || "?",
    height: drone.place ? (Math.round(10 * drone.place[2]) / 10 + 0).toFixed(1) : "?",  // no minus before a zero
    speed: drone.speed_mps.toFixed(1),
  })}`));
  if (drone.stale) head.append(element("span", ` ${say("stale")}`, "mark"));
  const rates = drone.rates_ps;
  const facts = [
    drone.battery === null ? null : say("battery", { percent: (100 * drone.battery).toFixed(0) }),
    drone.age_s === null ? say("never") : say("age", { age: drone.age_s.toFixed(1) }),
    drone.sigma_m === null ? null : say("localization", { kind: drone.localization, sigma: significant(drone.sigma_m) }),
    drone.clock_s === null ? null : say("clock", { ahead: (drone.clock_s < 0 ? "" : "+") + drone.clock_s.toFixed(3) }),
    drone.same_log ? say("same log") : null,
    drone.recognised === null ? null : say("recognised", { nuclide: drone.recognised }),
  ];
  const counts = rates === null ? say("no rates") : say("rates", {
    hits: rates[0].toFixed(0), full: significant(rates[1]), coincidences: significant(rates[2]),
  });
  item.append(head, element("div", facts.filter(Boolean).join(" · "), "dim"), element("div", counts, "dim"));
  const spectrum = spectrumOf(drone.id);
  if (spectrum) item.append(spectrum);
  if (drone.apart_m > far) item.append(element("div", say("apart", { apart: significant(drone.apart_m) }), "problem"));
  if (drone.other_mission) item.append(element("div", say("other mission", { mission: drone.other_mission }), "problem"));
  item.append(...coded(drone.problems, drone.problem_codes, "problem"), ...coded(drone.notices, drone.notice_codes, "dim"));
  return item;
}

export const eventText = (event) => say(`event ${event.text}`, event.values);

export function showEvents(events) {
  const items = events.slice(-MAX_EVENTS).map((event) => {
    const item = element("li", "", event.level);
    const time = element("time", clock(event.at_ms));
    time.dateTime = new Date(event.at_ms).toISOString();
    item.append(time, element("span", eventText(event)));
    return item;
  });
  document.getElementById("events").replaceChildren(...items.reverse());
}

/** Lines of texts, each with its code as an attribute: for style sheets and other readers of the page. */
function coded(texts, codes, className) {
  return texts.map((text, place) => {
    const line = element("div", text, className);
    if (codes[place]) line.dataset.code = codes[place]; // drones of former releases send none
    return line;
  });
}
