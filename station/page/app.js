// The page: what the station sends is drawn; the slider asks for earlier times.

import { drawCharts, moveCursor, showSpectra } from "./charts.js";
import { Commands } from "./commands.js";
import { Editor } from "./editor.js";
import { Link, MAX_SILENT_MS } from "./link.js";
import { SwarmMap } from "./map.js";
import { eventText, showDrones, showEvents, showSource } from "./panel.js";
import { offerReport } from "./report.js";
import { clock, duration, loadTexts, say } from "./texts.js";

const PLAY_MS = 100;
const CHART_MS = 1000;
const PANEL_MS = 250;  // what it says in words is read, not watched
const MAX_FRAME_MS = 2000;  // between two frames of a live flight; the station sends ten a second
const MOST_ROWS = 1200;  // of a flight that is watched for long, older ones are thinned
const by = (id) => document.getElementById(id);

const state = { mission: null, map: null, rows: [], events: [], live: true, at: 0, spectra: null, playing: false, share: null, link: null, lost: null, frame: null, framed: 0, waiting: null, frames: 0, known: false, silent: 0, charted: 0, worded: 0, told: "", moved: false };
window.radron = state;  // for whoever tests the page

function opened() {
  Object.assign(state, { rows: [], events: [], framed: performance.now() });
  ask(state.live ? { live: true } : { at_ms: Math.round(state.at) });
}

const ask = (wish) => state.link.ask(wish);

const receive = {
  mission(mission) {
    if (state.mission?.id !== mission.id) begin(mission);
    if (mission.replay) state.live = false;
    state.mission = mission;
    commands.offer(mission);
    editor.offer(mission, state.map);
    by("report").hidden = !mission.report;
    by("mission").textContent = `${mission.name} · ${mission.nuclide}`;
    document.title = `radron · ${mission.name}`;
    showLink();
  },
  overview({ rows }) {
    for (const row of rows) state.rows.push(row);
    if (state.rows.length > MOST_ROWS) state.rows = state.rows.filter((_, place) => place % 2 === 0 || place === state.rows.length - 1);
    if (performance.now() - state.charted > CHART_MS) drawTimes();
  },
  events({ events }) {
    state.events = events;
    showEvents(state.events);
  },
  event(event) {
    state.events.push(event);
    showEvents(state.events);
    by("said").textContent = eventText(event);
    commands.hear(event);
    editor.hear(event);
  },
  progress({ share }) {
    state.share = share;
    if (share === 1) drawTimes();
    if (share === 1 && !state.moved) lookAt(Number(by("time").max));
    showLink();
  },
  at({ at_ms, without, trails }) {
    state.map.without(without.filter((kind) => kind !== "spectra"));
    if (without.includes("spectra")) receive.spectra({ drones: [] });
    if (trails) state.map.sketch.beginAt(trails, at_ms);
  },
  frame(frame) {
    state.framed = performance.now();
    if (!state.waiting) requestAnimationFrame(drawFrame);
    state.waiting = frame;
  },
  cones({ cones }) {
    state.map.sketch.addCones(cones);
  },
  checked(result) {
    editor.checked(result);
  },
  belief(raster) {
    state.map.showRaster(raster);
  },
  spectra(spectra) {
    state.spectra = spectra;
    showSpectra(spectra, state.mission.energies_kev);
  },
  dose(raster) {
    state.map.showRaster(raster);
  },
};

// Another mission than before: the map begins anew.
function begin(mission) {
  state.map?.remove();
  state.map = new SwarmMap(mission);
  Object.assign(state, { rows: [], spectra: null, frame: null, waiting: null, at: 0, live: !mission.replay });
}

// Draw the newest frame, once for each picture of the screen; the station sends no more frames than are drawn.
function drawFrame() {
  const [frame, now] = [state.waiting, performance.now()];
  if (!frame) return;  // of another mission than is shown now
  Object.assign(state, { frame, waiting: null, frames: state.frames + 1 });
  if (state.live || !state.at) state.at = frame.at_ms;
  state.map.show(frame);
  const told = JSON.stringify([frame.source === null, frame.drones.map((drone) => [drone.stage, drone.stale, drone.problems])]);
  if (!state.live || told !== state.told || now - state.worded > PANEL_MS) {
    Object.assign(state, { told, worded: now });
    showSource(frame);
    showDrones(frame);
    editor.follow(frame);
    by("clock").textContent = `${clock(frame.at_ms)} UTC`;
  }
  showTime();
  if (now - state.charted > CHART_MS) drawTimes();
  ask({ drawn: true });
}

// Whether the link is alive and the picture moves; where not, that stands across the page, and what is old is grey.
function watchLink(alive, silentMs) {
  const frozenMs = performance.now() - state.framed;
  const isFrozen = state.live && state.frame !== null && frozenMs > MAX_FRAME_MS;
  const isLost = !alive && (state.known || silentMs > MAX_SILENT_MS);
  const lost = isLost ? state.link.refused ?? "link lost" : isFrozen ? "picture frozen" : null;
  state.known ||= alive;
  const seconds = Math.floor((alive ? frozenMs : silentMs) / 1000);
  if (lost === state.lost && (lost === null || seconds === state.silent)) return;
  const begins = lost !== state.lost;
  Object.assign(state, { lost, silent: seconds });
  document.body.classList.toggle("lost", lost !== null);
  by("lost").hidden = lost === null;
  if (lost !== null) by("lost-for").textContent = say("lost for", { seconds });
  if (begins) by("lost-what").textContent = lost === null ? "" : say(lost);
  if (begins) showLink();
  if (state.frame) showDrones(lost === null ? state.frame : aged(state.frame, seconds));
}

// A frame as it is to be read after some seconds without another one.
function aged(frame, seconds) {
  return { ...frame, drones: frame.drones.map((drone) => ({ ...drone, age_s: drone.age_s === null ? null : drone.age_s + seconds })) };
}

function showLink() {
  const link = by("link");
  const reading = state.share !== null && state.share < 1;
  const texts = [];
  if (state.lost !== null) texts.push(say("disconnected"));
  else if (state.mission?.replay) texts.push(reading ? say("reading", { percent: Math.floor(100 * state.share) }) : say("record"));
  else if (!state.live) texts.push(say("looking back"));
  else texts.push(say(state.known ? "connected" : "connecting"));
  if (state.lost === null && state.mission && !state.mission.replay) texts.push(say(state.mission.encrypted ? "encrypted" : "not encrypted"));
  link.textContent = texts.join(" · ");
  link.className = state.lost !== null || (!state.live && !state.mission?.replay) || (state.mission && !state.mission.replay && !state.mission.encrypted) ? "bad" : "";
}

function drawTimes() {
  if (!state.rows.length) return;
  state.charted = performance.now();
  const slider = by("time");
  slider.min = state.rows[0][0];
  slider.max = state.rows[state.rows.length - 1][0];
  if (state.live) slider.value = slider.max;
  if (state.mission) drawCharts(state.rows, state.mission.drones, state.at || state.rows[0][0]);
}

function showTime() {
  const slider = by("time");
  slider.value = state.at;
  by("at").textContent = state.rows.length ? duration(state.at - state.rows[0][0]) : "";
}

function lookAt(ms) {
  state.at = Math.min(Math.max(ms, Number(by("time").min)), Number(by("time").max));
  state.live = false;
  ask({ at_ms: Math.round(state.at) });
  showTime();
  showLink();
  moveCursor(state.rows, state.at);
}

function play(on) {
  state.playing = on;
  by("play").textContent = say(on ? "pause" : "play");
}

function tick() {
  if (!state.playing) return;
  const next = state.at + PLAY_MS * Number(by("speed").value);
  lookAt(next);
  if (next >= Number(by("time").max)) play(false);
}

function controls() {
  by("time").setAttribute("aria-label", say("time"));
  by("speed").setAttribute("aria-label", say("speed"));
  by("time").addEventListener("input", () => {
    play(false);
    state.moved = true;
    lookAt(Number(by("time").value));
  });
  by("play").addEventListener("click", () => {
    if (!state.playing && state.at >= Number(by("time").max)) lookAt(Number(by("time").min));
    play(!state.playing);
  });
  by("present").addEventListener("click", () => {
    play(false);
    if (state.mission?.replay) lookAt(Number(by("time").max));
    else {
      state.live = true;
      ask({ live: true });
      showLink();
    }
  });
  setInterval(tick, PLAY_MS);
  addEventListener("resize", () => {  // a tablet that is turned
    drawTimes();
    if (state.spectra) receive.spectra(state.spectra);
  });
}

await loadTexts();
offerReport();
state.link = new Link((said) => receive[said.kind]?.(said), opened, watchLink);
const commands = new Commands(state.link);
const editor = new Editor(state.link, (text, yes) => commands.confirmed(text, yes));
controls();
state.link.start();
