// What is drawn on the map, layer by layer, from the lowest to the topmost; those with a title can be switched.
import {$, element, ink, onScheme} from "./dom.js";
import {hear, known} from "./robot.js";
import {onPaint, redraw, toScreen, view} from "./map.js";
import {ground, lay} from "./ground.js";

const FOV_RAD = 1.0,
  SIGHT_M = 1.2,
  WAY_STEP_M = 0.03,
  HUSH_PX = 26;
const way = [];

hear("way", points => {
  // of the whole run, with null where the robot was carried
  way.splice(0, way.length, ...points);
  redraw();
});
hear("pose", ([x, y]) => {
  const last = way[way.length - 1];
  if (!last || Math.hypot(x - last[0], y - last[1]) > WAY_STEP_M) way.push([x, y]);
});
for (const subject of ["pose", "mission", "frontiers", "keyframes", "plan", "planes", "zones", "rooms", "slam"])
  hear(subject, redraw);
onScheme(redraw);

export const layers = {
  known: {title: "known ground", swatch: "free", shown: true, draw: pen => lay(pen, ground.free)},
  rooms: {title: "rooms", swatch: "room", shown: true, draw: drawRooms},
  planes: {title: "planes", swatch: "plane", shown: false, draw: drawPlanes},
  frontiers: {title: "frontiers", swatch: "frontier", shown: true, draw: drawFrontiers},
  walls: {title: "walls", swatch: "wall", shown: true, draw: pen => lay(pen, ground.walls)},
  zones: {title: "zones", swatch: "no-go", shown: true, draw: drawZones},
  way: {title: "way", swatch: "way", shown: true, draw: drawWay},
  keyframes: {title: "keyframes", swatch: "keyframe", shown: true, draw: drawKeyframes},
  views: {title: "views", swatch: "view", shown: true, draw: drawViews},
  plan: {title: "plan", swatch: "plan", shown: true, draw: drawPlan},
  robot: {shown: true, draw: drawRobot},
};
onPaint(pen => {
  for (const layer of Object.values(layers)) if (layer.shown) layer.draw(pen);
});

$("layers").append(
  ...Object.values(layers)
    .filter(layer => layer.title)
    .map(layer => {
      const button = element("button", layer.title, {className: "layer"});
      button.prepend(element("i", "", {className: layer.swatch}));
      const tell = () => button.setAttribute("aria-pressed", layer.shown);
      button.addEventListener("click", () => {
        layer.shown = !layer.shown;
        tell();
        redraw();
      });
      tell();
      return button;
    }),
);

export function trace(pen, points, colour, width, closed = false) {
  pen.strokeStyle = colour;
  pen.lineWidth = width;
  pen.lineJoin = "round";
  pen.beginPath();
  for (const [x, y] of points) pen.lineTo(...toScreen(x, y));
  if (closed) pen.closePath();
  pen.stroke();
}

export function dot(pen, [x, y], radius, colour) {
  pen.fillStyle = colour;
  pen.beginPath();
  pen.arc(...toScreen(x, y), radius, 0, 7);
  pen.fill();
}

export function label(pen, words, x, y, colour) {
  // in the middle of a place, readable on any ground
  const [px, py] = toScreen(x, y);
  pen.font = "600 12px system-ui, sans-serif";
  pen.textAlign = "center";
  pen.lineJoin = "round";
  pen.lineWidth = 3.5;
  pen.strokeStyle = ink("map-halo");
  pen.strokeText(words, px, py + 4);
  pen.fillStyle = colour;
  pen.fillText(words, px, py + 4);
  pen.textAlign = "left";
}

function drawWay(pen) {
  let piece = [];
  for (const point of [...way, null]) {
    if (point) piece.push(point);
    else {
      trace(pen, piece, ink("map-way"), 1.2);
      piece = [];
    }
  }
}

function drawRooms(pen) {
  const rooms = (known.rooms || {rooms: []}).rooms;
  pen.setLineDash([3, 5]);
  for (const room of rooms) trace(pen, room.outline, ink("map-room"), 1, true);
  pen.setLineDash([]);
  for (const room of rooms)
    if (Math.sqrt(room.area_m2) * view.pxPerM > HUSH_PX) label(pen, room.name, ...room.place, ink("map-room"));
}

function drawPlanes(pen) {
  for (const corners of known.planes || []) {
    trace(pen, corners, ink("map-plane"), 2, true);
    pen.globalAlpha = 0.12;
    pen.fillStyle = ink("map-plane");
    pen.fill();
    pen.globalAlpha = 1;
  }
}

function drawFrontiers(pen) {
  const side = Math.max(1.5, ground.resolution * view.pxPerM);
  pen.fillStyle = ink("map-frontier");
  for (const border of (known.frontiers || {borders: []}).borders) {
    for (const [x, y] of border) {
      const [px, py] = toScreen(x, y);
      pen.fillRect(px - side / 2, py - side / 2, side, side);
    }
  }
}

export const zoneInk = kind => ink("map-" + (kind === "wall" ? "no-go" : kind)); // "map-wall" is that of the ground map

export function drawZone(pen, zone, open = zone.kind === "wall") {
  const colour = zoneInk(zone.kind),
    [x, y] = zone.points.reduce((a, b) => [a[0] + b[0], a[1] + b[1]], [0, 0]);
  if (zone.kind === "look" || zone.kind === "slow") pen.setLineDash([7, 5]);
  trace(pen, zone.points, colour, open ? 3 : 2, !open);
  pen.setLineDash([]);
  if (!open && zone.kind !== "only" && zone.kind !== "look") {
    pen.globalAlpha = 0.16;
    pen.fillStyle = colour;
    pen.fill();
    pen.globalAlpha = 1;
  }
  if (zone.name) label(pen, zone.name, x / zone.points.length, y / zone.points.length, colour);
}
function drawZones(pen) {
  for (const zone of (known.zones || {zones: []}).zones) drawZone(pen, zone);
}

function drawKeyframes(pen) {
  for (const [x, y, looks] of known.keyframes || []) arrow(pen, x, y, looks, 4.5, ink("map-keyframe"));
}

function drawViews(pen) {
  // the larger, the more worth
  const {views} = known.frontiers || {views: []},
    best = Math.max(1e-9, ...views.map(v => v.utility || 0));
  for (const v of views.slice().reverse()) dot(pen, [v.x, v.y], 3 + (4 * (v.utility || 0)) / best, ink("map-view"));
}

function drawPlan(pen) {
  const goal = known.mission && known.mission.goal;
  trace(pen, known.plan || [], ink("map-plan"), 2.5);
  if (goal) ring(pen, goal, ink("map-plan"));
}

export function ring(pen, [x, y], colour) {
  pen.strokeStyle = colour;
  pen.lineWidth = 2;
  pen.beginPath();
  pen.arc(...toScreen(x, y), 7, 0, 7);
  pen.stroke();
}

function drawRobot(pen) {
  if (!known.pose) return;
  const [x, y, heading] = known.pose,
    [px, py] = toScreen(x, y),
    lost = known.slam && known.slam[0] === "LOST";
  pen.globalAlpha = 0.14;
  pen.fillStyle = ink("map-robot");
  pen.beginPath();
  pen.moveTo(px, py);
  pen.arc(px, py, SIGHT_M * view.pxPerM, -heading - FOV_RAD / 2, -heading + FOV_RAD / 2);
  pen.fill();
  pen.globalAlpha = 1;
  arrow(pen, x, y, heading, Math.min(18, Math.max(10, 0.18 * view.pxPerM)), ink(lost ? "danger" : "map-robot"));
}

export function arrow(pen, x, y, heading, size, colour) {
  pen.save();
  pen.translate(...toScreen(x, y));
  pen.rotate(-heading);
  pen.fillStyle = colour;
  pen.strokeStyle = ink("map-halo");
  pen.lineWidth = 1;
  pen.beginPath();
  pen.moveTo(size, 0);
  pen.lineTo(-0.7 * size, 0.65 * size);
  pen.lineTo(-0.35 * size, 0);
  pen.lineTo(-0.7 * size, -0.65 * size);
  pen.closePath();
  pen.fill();
  pen.stroke();
  pen.restore();
}
