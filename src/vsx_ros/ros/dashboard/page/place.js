// A place that was chosen on the map: the way there before it is driven, and the rooms and zones it lies in.
import {$, element, ink, sentence} from "./dom.js";
import {ask, command, hear, known, mayCommand} from "./robot.js";
import {onChoose, onPaint, redraw, showPlaceAbove, view} from "./map.js";
import {dot, ring, trace} from "./layers.js";
import {metres} from "./measures.js";
import {contains, distance} from "./shapes.js";
import {button, closeSheet, openSheet, row} from "./sheet.js";
import {nameRoom, removeZoneButton} from "./places.js";

const NEAR_PX = 12;
export const chosen = {place: null, way: null}; // x and y [m]; the way there: goal, points, length_m, seconds
let asking = new AbortController(); // for the way there
onChoose(choose);

export async function choose(x, y) {
  const line = element("p", mayCommand() ? "Looking for a way …" : "");
  openSheet(
    [row(element("b", metres(x, y)), element("span", located(x, y), {className: "soft"})), line, row(...actions(x, y))],
    forget,
  );
  $("sheet").dataset.matter = "place";
  const place = (chosen.place = [x, y]);
  showPlaceAbove($("sheet"), x, y);
  redraw();
  if (!mayCommand()) return;
  asking = new AbortController();
  const told = await ask("plan", {x, y}, asking);
  if (chosen.place !== place) return; // another place was chosen meanwhile, or none
  line.textContent = sentence(told.message);
  line.className = told.ok ? "" : "bad";
  chosen.way = told.ok ? told.data : null;
  const go = $("go");
  if (go) go.disabled = !told.ok;
  showPlaceAbove($("sheet"), x, y); // more words may have made it higher
  redraw();
}

function forget() {
  asking.abort();
  Object.assign(chosen, {place: null, way: null});
  redraw();
}

// Words for where it is, and for what is worth a look there.
function located(x, y) {
  const inside = roomsAt(x, y)
    .map(room => "in " + room.name)
    .concat(zonesAt(x, y).map(zone => `in zone ${zone.name} (${zone.kind})`));
  const {views} = known.frontiers || {views: []},
    near = views.find(v => Math.hypot(v.x - x, v.y - y) * view.pxPerM < NEAR_PX);
  return inside.concat(near ? ["view: " + near.text] : []).join(" · ");
}

const roomsAt = (x, y) => (known.rooms || {rooms: []}).rooms.filter(room => contains(room.outline, x, y));
const zonesAt = (x, y) =>
  (known.zones || {zones: []}).zones.filter(zone =>
    zone.kind === "wall" ? distance(zone.points, x, y) * view.pxPerM < NEAR_PX : contains(zone.points, x, y),
  );

function actions(x, y) {
  if (!mayCommand()) return [];
  const go = button(
    "Drive there",
    async () => {
      if ((await command("go", {x, y})).ok) closeSheet();
    },
    {id: "go", className: "main", disabled: true},
  );
  return [
    go,
    ...roomsAt(x, y).map(room => button(`Name ${room.name}`, () => nameRoom(room))),
    ...zonesAt(x, y).map(zone => removeZoneButton(zone, `Remove zone ${zone.name}`)),
  ];
}

onPaint(pen => {
  if (!chosen.place) return;
  if (chosen.way) {
    pen.setLineDash([8, 5]);
    trace(pen, chosen.way.points, ink("map-plan"), 3);
    pen.setLineDash([]);
  }
  ring(pen, chosen.place, ink("accent"));
  dot(pen, chosen.place, 2.5, ink("accent"));
});

// While the robot drives to an operator's goal, a button beside the reason ends that drive.
const end = button("End this drive", () => command("end-drive"), {id: "endDrive", hidden: true});
$("buttons").prepend(end);
hear("mission", mission => {
  end.hidden = mission.state !== "user goal";
});
