// The map as a place to look around in: zoom and move by wheel, drag, pinch and keys; a click chooses a place.
import {$, sized} from "./dom.js";

const LEAST_PX_M = 2,
  MOST_PX_M = 800,
  STEP = 1.25,
  KEY_PX = 60,
  CLICK_PX = 6,
  RING_PX = 12, // around a chosen place
  MOST_COVERED = 0.7,
  MARGIN = 0.94;
const canvas = $("map");

// The place in the middle [m], pixels per metre, size [px]; follows: it shows all of the map as it grows.
export const view = {x: 0, y: 0, pxPerM: 60, w: 1, h: 1, follows: true};
const fingers = new Map(); // pointer -> where it was last
let box = [-2, -2, 2, 2]; // of what is known: x, y, x, y [m]
let covered = 0, // pixels of its lower part, by a sheet
  moved = false,
  drawn = true,
  painters = [],
  chosen = () => {},
  pointed = () => {};

export const toScreen = (x, y) => [view.w / 2 + (x - view.x) * view.pxPerM, view.h / 2 - (y - view.y) * view.pxPerM];
export const toMap = (px, py) => [view.x + (px - view.w / 2) / view.pxPerM, view.y - (py - view.h / 2) / view.pxPerM];

export function onPaint(painter) {
  painters.push(painter);
}
export function onChoose(act) {
  chosen = act;
} // act(x, y) with metres
export function onPoint(act) {
  pointed = act;
} // act(x, y), or act() when the pointer is away
export function redraw() {
  drawn = false;
}

export function show(left, bottom, right, top) {
  box = [left, bottom, right, top];
  if (view.follows) fit();
}

export function fit() {
  view.follows = true;
  const pxPerM = clamped(MARGIN * Math.min(view.w / (box[2] - box[0]), (view.h - covered) / (box[3] - box[1])));
  Object.assign(view, {x: (box[0] + box[2]) / 2, y: (box[1] + box[3]) / 2 - covered / 2 / pxPerM, pxPerM});
  redraw();
}

// As long as the map shows all that is known, it does so above this sheet; null: no sheet any more.
export function showAbove(sheet) {
  covered = sheet ? Math.min(view.h - clearance(sheet), MOST_COVERED * view.h) : 0;
  if (view.follows) fit();
}

// The same if the sheet hides a place; then that is shown, whatever the map shows.
export function showPlaceAbove(sheet, x, y) {
  const low = () => Math.max(0, toScreen(x, y)[1] + RING_PX - clearance(sheet));
  if (!low()) return;
  showAbove(sheet);
  if (low()) pan(0, -low());
}
// Pixels between the upper edges of the map and of a sheet that may lie over it.
const clearance = sheet => Math.min(view.h, sheet.getBoundingClientRect().top - canvas.getBoundingClientRect().top);

export function paint() {
  const [pen, w, h] = sized(canvas);
  const resized = w !== view.w || h !== view.h;
  Object.assign(view, {w, h});
  if (resized && view.follows) fit();
  for (const painter of painters) painter(pen);
  drawn = true;
}
export function paintIfNeeded() {
  if (!drawn) paint();
}

function zoom(factor, px = view.w / 2, py = view.h / 2) {
  // what is at that pixel stays there
  const [x, y] = toMap(px, py);
  view.follows = false;
  view.pxPerM = clamped(view.pxPerM * factor);
  const [nowX, nowY] = toMap(px, py);
  pan((nowX - x) * view.pxPerM, -(nowY - y) * view.pxPerM);
}
const clamped = pxPerM => Math.min(MOST_PX_M, Math.max(LEAST_PX_M, pxPerM));

function pan(dx, dy) {
  // pixels that the map moves
  view.follows = false;
  view.x -= dx / view.pxPerM;
  view.y += dy / view.pxPerM;
  redraw();
}

const at = event => {
  const edge = canvas.getBoundingClientRect();
  return [event.clientX - edge.left, event.clientY - edge.top];
};
const middle = ([a, b]) => [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2],
  apart = ([a, b]) => Math.hypot(a[0] - b[0], a[1] - b[1]);

canvas.addEventListener("pointerdown", event => {
  canvas.setPointerCapture(event.pointerId);
  if (!fingers.size) moved = false;
  fingers.set(event.pointerId, at(event));
});
canvas.addEventListener("pointermove", event => {
  const here = at(event),
    last = fingers.get(event.pointerId);
  pointed(...toMap(...here));
  if (!last) return;
  if (fingers.size === 1 && !moved && apart([here, last]) < CLICK_PX) return;
  const before = [...fingers.values()];
  moved = true;
  fingers.set(event.pointerId, here);
  const now = [...fingers.values()];
  if (now.length === 1) pan(here[0] - last[0], here[1] - last[1]);
  if (now.length === 2) {
    const [x, y] = middle(before),
      [nowX, nowY] = middle(now);
    pan(nowX - x, nowY - y);
    zoom(apart(now) / Math.max(1, apart(before)), nowX, nowY);
  }
});
canvas.addEventListener("pointerup", event => {
  const alone = fingers.size === 1;
  fingers.delete(event.pointerId);
  if (alone && !moved && event.button === 0) chosen(...toMap(...at(event)));
});
canvas.addEventListener("pointercancel", event => fingers.delete(event.pointerId));
canvas.addEventListener("pointerleave", () => pointed());
canvas.addEventListener(
  "wheel",
  event => {
    event.preventDefault();
    const lines = event.deltaMode === WheelEvent.DOM_DELTA_LINE ? 30 : 1;
    zoom(Math.exp(-0.0015 * lines * event.deltaY), ...at(event));
  },
  {passive: false},
);

const keys = {
  ArrowLeft: () => pan(KEY_PX, 0),
  ArrowRight: () => pan(-KEY_PX, 0),
  ArrowUp: () => pan(0, KEY_PX),
  ArrowDown: () => pan(0, -KEY_PX),
  "+": () => zoom(STEP),
  "=": () => zoom(STEP),
  "-": () => zoom(1 / STEP),
  0: fit,
  Enter: () => chosen(view.x, view.y),
};
canvas.addEventListener("keydown", event => {
  if (!keys[event.key] || event.ctrlKey || event.metaKey || event.altKey) return;
  event.preventDefault();
  keys[event.key]();
});
canvas.addEventListener("focus", redraw);
canvas.addEventListener("blur", redraw);
$("zoomIn").addEventListener("click", () => zoom(STEP));
$("zoomOut").addEventListener("click", () => zoom(1 / STEP));
$("fit").addEventListener("click", fit);
new ResizeObserver(redraw).observe(canvas);
