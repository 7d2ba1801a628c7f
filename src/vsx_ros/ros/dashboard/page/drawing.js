// A zone is drawn: each click on the map is a corner, then it gets a kind and a name.
import {$, element} from "./dom.js";
import {command, known} from "./robot.js";
import {onChoose, onPaint, redraw, showAbove} from "./map.js";
import {dot, drawZone, trace, zoneInk} from "./layers.js";
import {choose} from "./place.js";
import {button, closeSheet, openSheet, row} from "./sheet.js";

const KINDS = {
  "no-go": "keep out of it",
  wall: "a line that is not crossed",
  only: "stay inside",
  slow: "drive slowly in it",
  look: "explore nothing outside",
};
export let draft = null; // {kind, points}

$("drawZone").addEventListener("click", () => {
  if (draft) closeSheet();
  else begin();
});

function begin() {
  openSheet([form()], stop);
  $("sheet").dataset.matter = "zone";
  draft = {kind: "no-go", points: []};
  onChoose((x, y) => {
    draft.points.push([x, y]);
    changed();
  });
  $("drawZone").setAttribute("aria-pressed", true);
  changed();
}

function stop() {
  draft = null;
  onChoose(choose);
  $("drawZone").setAttribute("aria-pressed", false);
  redraw();
}

const least = () => (draft.kind === "wall" ? 2 : 3);

function changed() {
  const count = draft.points.length,
    missing = least() - count;
  $("corners").textContent =
    missing > 0
      ? `Click ${count ? missing + " more" : "the"} corner${missing > 1 ? "s" : ""} on the map.`
      : `${count} corners.`;
  $("undo").disabled = !count;
  $("saveZone").disabled = missing > 0;
  $("speedBox").hidden = draft.kind !== "slow";
  showAbove($("sheet"));
  redraw();
}

function form() {
  const made = element("form"),
    kind = element("select", "", {id: "zoneKind"}),
    corners = element("p", "", {id: "corners"});
  kind.append(...Object.entries(KINDS).map(([value, words]) => element("option", `${value}: ${words}`, {value})));
  kind.addEventListener("change", () => {
    draft.kind = kind.value;
    changed();
  });
  const name = element("input", "", {id: "zoneName", value: freeName(), maxLength: 40, required: true});
  const speed = element("input", "", {id: "zoneSpeed", type: "number", value: 0.1, min: 0.03, max: 0.7, step: 0.01});
  const speedBox = labelled("at most m/s", speed);
  speedBox.id = "speedBox";
  made.append(
    corners,
    row(labelled("Kind", kind), labelled("Name", name), speedBox),
    row(
      element("button", "Save zone", {id: "saveZone", className: "main"}),
      button(
        "Undo corner",
        () => {
          draft.points.pop();
          changed();
        },
        {type: "button", id: "undo"},
      ),
      button("Cancel", closeSheet, {type: "button"}),
    ),
  );
  made.addEventListener("submit", event => {
    event.preventDefault();
    save(name.value.trim(), Number(speed.value));
  });
  return made;
}

async function save(name, v_m_s) {
  const points = draft.points.map(point => point.map(metre => Number(metre.toFixed(3))));
  const zone = {name, kind: draft.kind, points, ...(draft.kind === "slow" ? {v_m_s} : {})};
  if ((await command("zones", {add: zone})).ok) closeSheet();
}

function freeName() {
  const taken = new Set((known.zones || {zones: []}).zones.map(zone => zone.name));
  for (let i = 1; ; i++) if (!taken.has("zone " + i)) return "zone " + i;
}

function labelled(words, field) {
  const made = element("label", words + " ");
  made.append(field);
  return made;
}

onPaint(pen => {
  if (!draft || !draft.points.length) return;
  if (draft.points.length < least()) trace(pen, draft.points, zoneInk(draft.kind), 2);
  else drawZone(pen, draft);
  for (const point of draft.points) dot(pen, point, 4, zoneInk(draft.kind));
});
