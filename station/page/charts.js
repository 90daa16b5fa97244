// Charts over the whole flight, from the overview's rows: [time, [x, y, rms] or null, [x, y, hits] or null of each drone, ...];
// and the cameras' spectra.

import { colour, say } from "./texts.js";

const LEFT = 44;
const BOTTOM = 4;

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
  const [width, height] = [document.getElementById(id).clientWidth, 90];
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
  const y = (value) => height - BOTTOM - ((height - 2 * BOTTOM) * (Math.log10(value) - low)) / Math.max(0.1, high - low);
  context.font = "12px sans-serif";
  context.fillStyle = "#4a4a4a";
  context.strokeStyle = "#ddd";
  for (let power = Math.ceil(low); power <= Math.floor(high); power += 1) {
    const level = y(10 ** power);
    context.beginPath();
    context.moveTo(LEFT, level);
    context.lineTo(width, level);
    context.stroke();
    context.fillText(power >= 0 ? String(10 ** power) : (10 ** power).toFixed(-power), 2, level + 4);
  }
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
