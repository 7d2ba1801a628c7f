// The buttons of the mission, and the emergency stop by the space bar.
import {$} from "./dom.js";
import {command, hear, isOperator, mayCommand, say} from "./robot.js";

for (const button of document.querySelectorAll("button[data-command]"))
  if (button.id !== "estop") button.addEventListener("click", () => command(button.dataset.command));
// The emergency stop acts when it is pressed, not when it is let go: a second finger, while a first one holds the
// stick, makes no click.
$("estop").addEventListener("pointerdown", () => command("estop"));
$("estop").addEventListener("click", event => {
  if (event.detail === 0) command("estop");
}); // by Enter

// The robot says first whether it obeys this page; a page of an earlier run has an old token.
const LOOKING = "Looking only: the buttons need the whole address that the terminal shows now, with what follows #.";
function arm() {
  for (const button of document.querySelectorAll("[data-command], #stop, #drawZone, #byHand, #endDrive"))
    button.disabled = !isOperator();
  if (!isOperator()) say(LOOKING, true);
  else if ($("said").textContent === LOOKING) say("The buttons work.");
}
hear("operator", arm);
arm();

function stopAsks(asks) {
  $("stopAsks").hidden = !asks;
  (asks ? $("stopNot") : $("stop")).focus();
}
$("stop").addEventListener("click", () => stopAsks(true));
for (const button of $("stopAsks").querySelectorAll("button")) button.addEventListener("click", () => stopAsks(false));
$("stopAsks").addEventListener("keydown", event => {
  if (event.key === "Escape") stopAsks(false);
});

// Whatever has the focus, the space bar stops the wheels; buttons are pressed by Enter. Only where words are written,
// it writes.
const writes = target => target instanceof HTMLInputElement || target instanceof HTMLTextAreaElement;
window.addEventListener(
  "keydown",
  event => {
    if (event.key !== " " || writes(event.target)) return;
    event.preventDefault();
    if (mayCommand() && !event.repeat) command("estop");
  },
  true,
);
window.addEventListener(
  "keyup",
  event => {
    if (event.key === " " && !writes(event.target)) event.preventDefault();
  },
  true,
);
