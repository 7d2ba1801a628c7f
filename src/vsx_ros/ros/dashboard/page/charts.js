// Two minutes of tracking and of times.
import {$, ink, sized} from "./dom.js";
import {hear, known} from "./robot.js";

const MEMORY_S = 120,
  GOOD_RATIO = 0.3,
  GAP_S = 2;
const LEFT = 38,
  BOTTOM = 14; // pixels for the words
export const series = {ratio: [], latency: [], planning: []};

hear("stats", s => {
  const now = performance.now() / 1000;
  if (s.attempted !== undefined && s.tracked !== undefined)
    note("ratio", now, s.attempted ? Math.min(1, s.tracked / s.attempted) : 0);
  if (s.latency_ms !== undefined) note("latency", now, s.latency_ms);
  if (s.plan_ms !== undefined && s.plan_ms !== known.planMs) {
    known.planMs = s.plan_ms;
    note("planning", now, s.plan_ms);
  }
});

function note(name, t, value) {
  const rows = series[name];
  rows.push([t, value]);
  while (rows.length && rows[0][0] < t - MEMORY_S) rows.shift();
}

export function drawCharts() {
  drawRatio();
  drawLatency();
  drawPlanning();
}
export function drawRatio() {
  chart("ratio", {share: true, mark: GOOD_RATIO});
}
export function drawLatency() {
  chart("latency", {});
}
export function drawPlanning() {
  chart("planning", {dots: true});
}

function chart(name, {share, mark, dots}) {
  const [pen, w, h] = sized($(name)),
    rows = series[name],
    now = performance.now() / 1000;
  const peak = share ? 1 : Math.max(10, ...rows.map(row => row[1])) * 1.15;
  const words = value => (share ? (100 * value).toFixed(0) + " %" : value.toFixed(0) + " ms");
  const x = t => w - 1 - ((now - t) / MEMORY_S) * (w - LEFT - 2);
  const y = value => h - BOTTOM - (Math.min(value, peak) / peak) * (h - BOTTOM - 6);
  const level = (value, colour) => {
    pen.strokeStyle = colour;
    pen.beginPath();
    pen.moveTo(LEFT, y(value));
    pen.lineTo(w, y(value));
    pen.stroke();
  };
  pen.font = "10px system-ui, sans-serif";
  pen.fillStyle = ink("soft");
  pen.lineWidth = 1;
  for (const value of [0, peak / 2, peak]) {
    level(value, ink("line"));
    pen.fillText(words(value), 0, y(value) + 3);
  }
  pen.fillText("2 min ago", LEFT, h - 2);
  pen.fillText("now", w - 21, h - 2);
  if (mark) {
    pen.setLineDash([4, 4]);
    level(mark, ink("map-keyframe"));
    pen.setLineDash([]);
  }
  pen.strokeStyle = pen.fillStyle = ink("accent");
  pen.lineWidth = 1.5;
  pen.beginPath();
  rows.forEach(([t, value], i) => {
    if (dots) {
      pen.moveTo(x(t) + 2.5, y(value));
      pen.arc(x(t), y(value), 2.5, 0, 7);
    } else if (i && t - rows[i - 1][0] < GAP_S) pen.lineTo(x(t), y(value));
    else pen.moveTo(x(t), y(value));
  });
  if (dots) pen.fill();
  else pen.stroke();
  $(name + "Now").textContent = rows.length ? words(rows[rows.length - 1][1]) : "";
}
