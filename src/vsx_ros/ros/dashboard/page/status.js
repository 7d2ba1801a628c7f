// The state in words, figures and health.
import {$, element, fixed, lines, pill, sentence} from "./dom.js";
import {hear, known, link} from "./robot.js";
import {closeSheet} from "./sheet.js";
import {putAway} from "./stick.js";

const STALE_MS = 2500;
const MOODS = {
  mapping: "good", done: "good", recovering: "fair", paused: "fair", "user goal": "fair", held: "bad",
  "no images": "bad",
};
const SILENT = 3;
const LEVELS = [
  ["good", "well"],
  ["fair", "warning"],
  ["bad", "error"],
  ["soft", "silent"],
];

hear("camera", jpeg => {
  $("camera").src = "data:image/jpeg;base64," + jpeg;
  known.pictures = (known.pictures || 0) + 1;
  known.cameraAt = performance.now();
});
hear("mission", mission => {
  if (known.end && mission.state !== "done") {
    delete known.end;
    showEnd(false);
  }
  state();
});
hear("slam", state);
hear("hazards", state);
hear("silent", state);
hear("held", state);
hear("dock", dock => {
  $("dock").hidden = !dock.known && !dock.docked;
  $("dock").textContent = dock.docked ? "Leave dock" : "Charge";
  $("dock").dataset.command = dock.docked ? "undock" : "dock";
  state();
  numbers();
});
function showEnd(over) {
  if (over && $("end").hidden) {
    closeSheet();
    putAway();
  }
  document.body.classList.toggle("ended", over);
  $("end").hidden = !over;
  $("buttons").hidden = over;
}
hear("end", end => {
  showEnd(true);
  $("end").className = end.ok ? "good" : "";
  $("endReason").textContent = sentence(end.reason);
  $("endFolder").textContent = end.folder;
  lines("endFacts", end.facts, fact => [fact]);
  $("endReport").hidden = !end.report;
  pill("mission", "ENDED", end.ok ? "good" : "bad");
  $("why").textContent = "";
  pill("slam", "camera off", "");
});
hear("rooms", () => numbers());
hear("stats", s => {
  $("found").textContent = s.attempted ? `${s.tracked} of ${s.attempted} points` : "";
  numbers();
});
hear("health", all => {
  $("release").hidden = component("mobile_base: safety")[2].estop !== "True";
  numbers();
  const order = Object.entries(all).sort((a, b) => b[1][0] - a[1][0] || a[0].localeCompare(b[0]));
  lines("health", order, ([name, [level, message]]) => {
    const [kind, word] = LEVELS[level] || LEVELS[2],
      dot = element("span", "", {className: "dot " + kind, title: word});
    dot.setAttribute("role", "img");
    dot.setAttribute("aria-label", word);
    return [dot, element("b", name), message];
  });
});
const clock = stamp_ns => new Date(stamp_ns / 1e6).toLocaleTimeString();

function state() {
  const mission = known.mission || {},
    slam = known.slam || ["", ""];
  const quiet = known.silent || [],
    lost = mission.state && mission.state !== "done" && quiet.includes("mission");
  if (lost) pill("mission", "SILENT", "");
  else if (mission.state)
    pill("mission", mission.state.toUpperCase(), known.hazards ? "bad" : MOODS[mission.state] || "");
  if (slam[0] && quiet.includes("slam")) pill("slam", "camera silent", "");
  else if (slam[0]) pill("slam", slam[0].replaceAll("_", " "), {TRACKING: "good", LOST: "bad"}[slam[0]] || "fair");
  const paused = mission.state === "paused";
  $("pause").textContent = paused ? "Resume" : "Pause";
  $("pause").dataset.command = paused ? "resume" : "pause";
  if (known.end) return;
  const [words, figures] = (mission.reason || "").split(" [");
  $("why").textContent =
    [
      known.hazards && "hazard: " + known.hazards,
      docking(),
      lost ? "the exploration says nothing any more; before: " + words : sentence(words),
      lost ? "" : left(mission.left_s),
      slam[1] && "camera: " + slam[1],
    ]
      .filter(Boolean)
      .join(" · ") || "waiting for the robot";
  $("figures").hidden = !figures;
  $("figuresText").textContent = (figures || "").replace(/\]$/, "");
}

// What the docking does; nothing before the first one, and after the dock is left.
function docking() {
  const dock = known.dock || {};
  return dock.reason && dock.state !== "undocked" && "dock: " + dock.reason;
}

// As vsx status says it; nothing while the estimate is not proven.
function left(left_s) {
  if (left_s == null) return "";
  const minutes = Math.round(left_s / 60);
  return left_s < 45 ? "less than a minute left" : `about ${minutes} minute${minutes > 1 ? "s" : ""} left`;
}

// Share of the ground within the rooms found so far.
function roomsKnown() {
  const {rooms} = known.rooms || {rooms: []},
    sum = size => rooms.reduce((total, room) => total + size(room), 0),
    all_m2 = sum(room => room.area_m2 / Math.max(room.known_ratio, 0.01));
  return all_m2 ? ((100 * sum(room => room.area_m2)) / all_m2).toFixed(0) + " %" : "–";
}

function component(name) {
  // level, message, values; a namespace may stand before the name
  const found = Object.entries(known.health || {}).find(([key]) => key.endsWith(name));
  return found ? found[1] : [0, "", {}];
}

function lasts(left_s) {
  const minutes = Math.round(left_s / 60),
    hours = Math.floor(minutes / 60);
  return hours ? `${hours} h ${minutes % 60} min` : `${minutes} min`;
}

const elapsed = s => (s == null ? "–" : Math.floor(s / 60) + ":" + String(Math.floor(s % 60)).padStart(2, "0"));

export function numbers() {
  const s = known.stats || {},
    [, images, input] = component("vslam: input"),
    [mood, , cells] = component("mobile_base: battery"),
    battery = mood === SILENT ? {} : cells;
  const mission = known.mission || {},
    dock = known.dock || {},
    unit = (value, digits, name) => (value == null ? "–" : value.toFixed(digits) + " " + name);
  const shown = [
    ["elapsed", elapsed(mission.elapsed_s)],
    ["driven", unit(mission.driven_m, 1, "m")],
    ["known area", unit(mission.known_area_m2, 0, "m²")],
    ["rooms known", roomsKnown()],
    ["keyframes", fixed(s.keyframes, 0)],
    ["map points", fixed(s.points, 0)],
    ["images / s", /^\d/.test(images) ? parseInt(images) : "–"],
    ["images skipped", input.dropped ?? "–"],
    ["battery", battery.fraction ? (100 * battery.fraction).toFixed(0) + " %" : "–"],
    ["battery lasts", dock.battery_left_s == null ? "–" : lasts(dock.battery_left_s)],
  ];
  $("numbers").replaceChildren(
    ...shown.map(([name, value]) => {
      const box = element("div", name);
      box.prepend(element("b", value));
      return box;
    }),
  );
}

// Twice a second: is what the page shows still true, and may the robot drive?
export function watch() {
  const now = performance.now(),
    silent = now - link.heard > STALE_MS;
  $("camera").classList.toggle("stale", now - (known.cameraAt || 0) > STALE_MS);
  document.body.classList.toggle("old", silent || (known.stack === false && !known.end));
  const words = trouble(silent);
  $("banner").hidden = !words;
  if ($("banner").textContent !== words) $("banner").textContent = words;
}

function trouble(silent) {
  const over = known.end || (known.mission && known.mission.state === "done"),
    held = known.held;
  if (silent && over) return "The run is over and its processes have ended. What you see is how it ended.";
  if (silent)
    return `No connection to the robot${link.refused && ": " + link.refused}; what you see is old. Trying again …`;
  if (known.stack === false) return "The ROS master is away; the view comes back with it.";
  if (over || !held || !held.by) return "";
  const ends =
    held.by === "emergency stop"
      ? "Release e-stop lets the exploration go on."
      : "The exploration goes on by itself afterwards.";
  return `The operator holds the wheels: ${held.by}, since ${clock(held.since_ns)}. ${ends}`;
}
