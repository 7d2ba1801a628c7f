// On top of the map: the scale bar, the place under the pointer, and the middle for those who use keys.
import {$, ink} from "./dom.js";
import {onPaint, onPoint, view} from "./map.js";

const LENGTHS_M = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100],
  LEAST_PX = 56,
  EDGE = 14;

export const metres = (x, y) => `x ${x.toFixed(2)}, y ${y.toFixed(2)} m`.replaceAll("-", "−");

onPoint((x, y) => {
  $("where").textContent = x === undefined ? "" : metres(x, y);
});

onPaint(pen => {
  const metre = LENGTHS_M.find(m => m * view.pxPerM >= LEAST_PX) || 200,
    px = metre * view.pxPerM,
    y = view.h - EDGE;
  pen.beginPath();
  pen.moveTo(EDGE, y - 5);
  pen.lineTo(EDGE, y);
  pen.lineTo(EDGE + px, y);
  pen.lineTo(EDGE + px, y - 5);
  for (const [colour, width] of [
    ["map-halo", 4],
    ["soft", 1.5],
  ]) {
    pen.strokeStyle = ink(colour);
    pen.lineWidth = width;
    pen.stroke();
  }
  pen.font = "12px system-ui, sans-serif";
  pen.lineWidth = 3;
  pen.strokeStyle = ink("map-halo");
  const words = metre < 1 ? 100 * metre + " cm" : metre + " m";
  pen.strokeText(words, EDGE + 6, y - 6);
  pen.fillStyle = ink("soft");
  pen.fillText(words, EDGE + 6, y - 6);
  if ($("map").matches(":focus-visible")) {
    pen.strokeStyle = ink("accent");
    pen.lineWidth = 1.5;
    pen.beginPath();
    for (const [dx, dy] of [
      [1, 0],
      [-1, 0],
      [0, 1],
      [0, -1],
    ]) {
      pen.moveTo(view.w / 2 + 4 * dx, view.h / 2 + 4 * dy);
      pen.lineTo(view.w / 2 + 14 * dx, view.h / 2 + 14 * dy);
    }
    pen.stroke();
  }
});
