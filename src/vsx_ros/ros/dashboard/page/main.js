// The live view: what the robot tells is drawn, and what its operator wants is sent.
import {$, onScheme} from "./dom.js";
import {connect, hear, known, link} from "./robot.js";
import {numbers, watch} from "./status.js";
import {drawCharts, drawLatency, drawPlanning, drawRatio, series} from "./charts.js";
import {fit, paint, paintIfNeeded, toMap, toScreen, view} from "./map.js";
import {ground} from "./ground.js";
import {layers} from "./layers.js";
import {chosen} from "./place.js";
import {draft} from "./drawing.js";
import {hand} from "./stick.js";
import {collapsed} from "./events.js";
import "./buttons.js";

const WATCH_MS = 500,
  CHARTS_MS = 500;

// A hidden page costs the robot nothing and waits for the end, which is served as long as its page is connected.
function follow() {
  const path = document.hidden && !known.end ? "/end" : "/events";
  if (link.path !== path) connect(path);
}
document.addEventListener("visibilitychange", follow);
hear("end", follow);
hear("mission", follow);
setInterval(watch, WATCH_MS);
setInterval(() => {
  if (!document.hidden) drawCharts();
}, CHARTS_MS);
(function frame() {
  paintIfNeeded();
  requestAnimationFrame(frame);
})(); // rests while the page is hidden
onScheme(drawCharts);
numbers();
link.heard = performance.now();
follow();

// For the console of the browser, and for tests.
Object.assign(globalThis, {
  $,
  known,
  series,
  view,
  ground,
  layers,
  chosen,
  hand,
  collapsed,
  fit,
  paint,
  toMap,
  toScreen,
  drawRatio,
  drawLatency,
  drawPlanning,
});
Object.defineProperty(globalThis, "draft", {get: () => draft});
