// Charts over the whole flight, from the overview's rows: [time, [x, y, rms] or null, [x, y, hits] or null of each drone, ...];
// and the cameras' spectra.

import { colour, duration, say } from "./texts.js";

const LEFT = 44;
const [TOP, BOTTOM] = [4, 18];
const HEIGHT = 106;
const STEPS_S = [5, 10, 20, 30, 60, 120, 300, 600, 1200, 1800, 3600, 7200, 18000];  // between the times that are written
const MOST_TIMES = 5;

const CHARTS = ["chart-rms", "chart-hits"];
const drawn = Object.fromEntries(CHARTS.map((id) => [id, document.createElement("canvas")]));  // without the cursor

export function drawCharts(rows, drones, at) {
  draw("chart-rms", rows, [{ colour: "#111", value: (row) => row[1]?.[2] ?? null }]);
  draw("chart-hits", rows, drones.map((_, index) => ({ colour: colour(index), value: (row) => row[index + 2]?.[2] ?? null })));
  moveCursor(rows, at);
}

// Show the charts as they were drawn, with the cursor at a time.
export function moveCursor(rows, at) {
  if (rows.length < 2) return;
  for (const id of CHARTS) {
    const [canvas, chart] = [document.getElementById(id), drawn[id]];
    if (!chart.width || !canvas.clientWidth) continue;
    Object.assign(canvas, { width: chart.width, height: chart.height });
    const context = canvas.getContext("2d");
    context.drawImage(chart, 0, 0);
    const ratio = chart.width / canvas.clientWidth;
    const x = ratio * place(at, rows, canvas.clientWidth);
    context.strokeStyle = "#a33b00";
    context.lineWidth = ratio;
    context.beginPath();
    context.moveTo(x, 0);
    context.lineTo(x, canvas.height);
    context.stroke();
  }
}

function place(ms, rows, width) {
  const [first, last] = [rows[0][0], rows[rows.length - 1][0]];
  return LEFT + ((width - LEFT - 4) * (ms - first)) / Math.max(1, last - first);
}

// The rows for a chart: in each column of it, for each series the row with the largest value, so that no peak is lost.
function thinned(rows, value, columns) {
  const every = Math.ceil(rows.length / columns);
  if (every === 1) return rows;
  const found = [];
  for (let first = 0; first < rows.length; first += every) {
    let most = rows[first];
    for (let row = first + 1; row < Math.min(first + every, rows.length); row += 1) {
      if (value(rows[row]) > (value(most) ?? -1)) most = rows[row];
    }
    found.push(most);
  }
  return found;
}

function draw(id, rows, series) {
  const canvas = drawn[id];
  const ratio = window.devicePixelRatio || 1;
  const [width, height] = [document.getElementById(id).clientWidth, HEIGHT];
  canvas.width = width * ratio;
  canvas.height = height * ratio;
  const context = canvas.getContext("2d");
  context.scale(ratio, ratio);
  if (rows.length < 2) return;
  const lines = series.map((one) => thinned(rows, one.value, Math.max(1, width - LEFT)).map((row) => [row[0], one.value(row)]));
  let [least, most] = [Infinity, 0];
  for (const line of lines) {
    for (const [, value] of line) {
      if (value > 0) [least, most] = [Math.min(least, value), Math.max(most, value)];
    }
  }
  if (!most) return;
  const [low, high] = [Math.log10(least), Math.log10(most * 1.05)];
  const x = (ms) => place(ms, rows, width);
  const y = (value) => height - BOTTOM - ((height - TOP - BOTTOM) * (Math.log10(value) - low)) / Math.max(0.1, high - low);
  context.font = "12px sans-serif";
  context.fillStyle = "#4a4a4a";
  context.strokeStyle = "#ddd";
  for (const value of levels(low, high)) {
    const level = y(value);
    context.beginPath();
    context.moveTo(LEFT, level);
    context.lineTo(width, level);
    context.stroke();
    context.fillText(String(Number(value.toPrecision(2))), 2, Math.max(10, level + 4));
  }
  drawTimes(context, rows, x, width, height);
  lines.forEach((line, index) => {
    context.strokeStyle = series[index].colour;
    context.lineWidth = 2;
    context.beginPath();
    let drawing = false;
    for (const [ms, value] of line) {
      if (value === null || value <= 0) drawing = false;
      else if (drawing) context.lineTo(x(ms), y(value));
      else {
        context.moveTo(x(ms), y(value));
        drawing = true;
      }
    }
    context.stroke();
  });
}

// Values that are written beside a chart, of which the logarithms are given: powers of ten, or more where there are few of those.
function levels(low, high) {
  const found = [];
  for (let power = Math.floor(low); power <= Math.ceil(high); power += 1) {
    for (const digit of high - low > 1.5 ? [1] : [1, 2, 5]) {
      const value = digit * 10 ** power;
      if (Math.log10(value) >= low && Math.log10(value) <= high) found.push(value);
    }
  }
  return found.length ? found : [10 ** high];
}

function drawTimes(context, rows, x, width, height) {
  const [first, last] = [rows[0][0], rows[rows.length - 1][0]];
  const step = 1000 * (STEPS_S.find((seconds) => (last - first) / (1000 * seconds) <= MOST_TIMES) ?? 36000);
  for (let ms = 0; ms <= last - first; ms += step) {
    const [place, text] = [x(first + ms), duration(ms)];
    context.fillRect(place, height - BOTTOM, 1, 4);
    if (place + context.measureText(text).width < width) context.fillText(text, place + 3, height - 3);
  }
}

const SPECTRUM_HEIGHT = 70;
const ENERGIES_KEV = [60, 200, 500, 1000];  // that are written
const spectra = new Map();

// The canvas of a drone's spectrum; undefined while it has none.
export function spectrumOf(name) {
  return spectra.get(name);
}

// Counts by bin on a logarithmic scale: single clusters as bars, coincidences as a line.
export function showSpectra({ drones }, edges) {
  for (const name of spectra.keys()) if (!drones.some(({ id }) => id === name)) spectra.delete(name);
  for (const drone of drones) {
    if (!spectra.has(drone.id)) {
      const canvas = Object.assign(document.createElement("canvas"), { className: "spectrum" });
      canvas.setAttribute("role", "img");
      spectra.set(drone.id, canvas);
    }
    const sum = (counts) => counts.reduce((one, other) => one + other, 0);
    const words = { live: drone.live_s.toFixed(0), singles: sum(drone.singles), coincidences: sum(drone.coincidences) };
    const canvas = spectra.get(drone.id);
    canvas.setAttribute("aria-label", say("spectrum", words));
    canvas.title = say("spectrum", words);
    drawSpectrum(canvas, drone, edges);
  }
}

function drawSpectrum(canvas, { singles, coincidences }, edges) {
  const ratio = window.devicePixelRatio || 1;
  const width = canvas.clientWidth || document.getElementById("drones").clientWidth - 28;  // before it is laid out for the first time
  const height = SPECTRUM_HEIGHT;
  Object.assign(canvas, { width: width * ratio, height: height * ratio });
  const context = canvas.getContext("2d");
  context.scale(ratio, ratio);
  const base = height - 16;
  const most = Math.log10(1 + Math.max(1, ...singles, ...coincidences));
  const y = (count) => base - ((base - 4) * Math.log10(1 + count)) / most;
  const step = width / singles.length;
  context.fillStyle = "#5f8fb3";
  singles.forEach((count, bin) => context.fillRect(bin * step, y(count), step - 1, base - y(count)));
  context.strokeStyle = "#8a3a00";
  context.lineWidth = 2;
  context.beginPath();
  coincidences.forEach((count, bin) => {
    context.lineTo(bin * step, y(count));
    context.lineTo((bin + 1) * step, y(count));
  });
  context.stroke();
  context.fillStyle = "#111";
  context.font = "12px sans-serif";
  for (const energy of ENERGIES_KEV) {
    const bin = edges.findIndex((edge) => edge > energy) - 1;
    const x = step * (bin + (energy - edges[bin]) / (edges[bin + 1] - edges[bin]));
    context.fillRect(x, base, 1, 4);
    context.fillText(energy === ENERGIES_KEV.at(-1) ? say("kev", { energy }) : energy, x + 3, height - 3);
  }
}
