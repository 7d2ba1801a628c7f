// Zones and rooms as lists: what there is, and how to name and remove it.
import {$, element, lines} from "./dom.js";
import {command, hear, isOperator, known} from "./robot.js";
import {askingButton, button, closeSheet, openSheet, row} from "./sheet.js";

hear("zones", ({zones}) =>
  list("zones", zones, "none yet: draw one on the map", "name", zone => [
    element("i", "", {className: zone.kind}),
    element("b", zone.name),
    zone.kind + (zone.v_m_s ? `, at most ${zone.v_m_s} m/s` : ""),
    ...(isOperator() ? [removeZoneButton(zone, "Remove")] : []),
  ]),
);
hear("rooms", ({rooms}) =>
  list("rooms", rooms, "none found yet", "number", room => [
    element("b", room.name),
    `${room.area_m2.toFixed(0)} m², ${(100 * room.known_ratio).toFixed(0)} % known`,
    ...(isOperator() ? [button("Name", () => nameRoom(roomNow(room.number)))] : []),
  ]),
);
lines("zones", ["none yet"], words => [words]);
lines("rooms", ["none found yet"], words => [words]);

const roomNow = number => known.rooms.rooms.find(room => room.number === number); // its name may be another one by now

function list(id, entries, none, key, parts) {
  if (entries.length) lines(id, entries, parts, entry => entry[key]);
  else lines(id, [none], words => [words]);
}

export function removeZoneButton(zone, words) {
  return askingButton(words, "Really remove?", async () => {
    if ((await command("zones", {remove: zone.name})).ok && $("sheet").dataset.matter === "place") closeSheet();
  });
}

export function nameRoom(room) {
  const name = element("input", "", {value: room.name, maxLength: 40, required: true, id: "roomName"});
  const form = element("form");
  const label = element("label", `Name of ${room.name} `);
  label.append(name);
  form.append(
    row(label, element("button", "Name it", {className: "main"}), button("Cancel", closeSheet, {type: "button"})),
  );
  form.addEventListener("submit", async event => {
    event.preventDefault();
    if ((await command("name-room", {room: room.number, name: name.value.trim()})).ok) closeSheet();
  });
  openSheet([form]);
  $("sheet").dataset.matter = "room";
  name.select();
}
