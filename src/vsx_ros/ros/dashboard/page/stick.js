// The stick for a thumb, or for the arrow keys. The robot drives only as long as it is held: letting go stops at once,
// and the base itself forgets a movement that is not said again within half a second.
import {$, sentence} from "./dom.js";
import {ask, mayCommand, say} from "./robot.js";

const PERIOD_MS = 100,
  DEAD = 0.12;
const ARROWS = {ArrowUp: [1, 0], ArrowDown: [-1, 0], ArrowLeft: [0, 1], ArrowRight: [0, -1]};
const stick = $("stick"),
  pressed = new Set();
export const hand = {forward: 0, left: 0, holds: false, sent: 0}; // shares of full speed; sent: how many movements
let grip = null,
  thumb = null; // the present hold; the pointer that holds

$("byHand").addEventListener("click", () => {
  stick.hidden = !stick.hidden;
  $("byHand").setAttribute("aria-pressed", !stick.hidden);
  if (stick.hidden) letGo();
  else stick.focus();
});
export function putAway() {
  if (!stick.hidden) $("byHand").click();
}

stick.addEventListener("pointerdown", event => {
  if (thumb !== null) return;
  thumb = event.pointerId;
  stick.setPointerCapture(thumb);
  hold(...lean(event));
});
stick.addEventListener("pointermove", event => {
  if (event.pointerId === thumb) hold(...lean(event));
});
for (const end of ["pointerup", "pointercancel", "lostpointercapture"]) {
  stick.addEventListener(end, event => {
    if (event.pointerId === thumb) letGo();
  });
}
stick.addEventListener("contextmenu", event => event.preventDefault()); // a thumb that rests for long
stick.addEventListener("blur", letGo);
window.addEventListener("blur", letGo);
window.addEventListener("pagehide", letGo);
document.addEventListener("visibilitychange", () => {
  if (document.hidden) letGo();
});

stick.addEventListener("keydown", event => {
  if (ARROWS[event.key]) {
    event.preventDefault();
    pressed.add(event.key);
    byKeys();
  }
});
stick.addEventListener("keyup", event => {
  if (pressed.delete(event.key)) byKeys();
});
function byKeys() {
  const [forward, left] = [0, 1].map(i => [...pressed].reduce((sum, key) => sum + ARROWS[key][i], 0));
  if (forward || left) hold(forward, left);
  else letGo();
}

function lean(event) {
  // of the stick, within a circle; a little around the centre is the centre
  const edge = stick.getBoundingClientRect(),
    radius = edge.width / 2;
  const left = (edge.left + radius - event.clientX) / radius,
    forward = (edge.top + radius - event.clientY) / radius;
  const length = Math.hypot(forward, left),
    share = length < DEAD ? 0 : Math.min(1, length) / length;
  return [share * forward, share * left];
}

function hold(forward, left) {
  Object.assign(hand, {forward, left});
  draw();
  if (!hand.holds) {
    hand.holds = true;
    drive();
  }
}

function letGo() {
  pressed.clear();
  thumb = null;
  if (!hand.holds) return;
  Object.assign(hand, {forward: 0, left: 0, holds: false});
  draw();
  grip.abort();
  stand();
}

function draw() {
  const reach = stick.clientWidth / 4;
  $("knob").style.transform = `translate(${-hand.left * reach}px, ${-hand.forward * reach}px)`;
  stick.classList.toggle("held", hand.holds);
}

// One movement after another, each with the ticket of the last answer: what comes late is not obeyed.
async function drive() {
  const mine = (grip = new AbortController());
  for (let ticket = 0; hand.holds && mine === grip;) {
    const began = performance.now(),
      first = ticket === 0; // the first one only fetches a ticket
    const answer = await ask("drive", {forward: hand.forward, left: hand.left, ticket}, mine);
    if (answer.aborted) return;
    hand.sent += 1;
    if (!answer.ok) say(sentence("not done: " + answer.message));
    ticket = answer.data ? answer.data.ticket : 0;
    if (!first || !ticket) await new Promise(done => setTimeout(done, PERIOD_MS - (performance.now() - began)));
  }
}

async function stand() {
  // said again if it gets no answer, unless a hand holds the stick again
  for (let i = 0; i < 5 && !hand.holds && mayCommand(); i++) {
    const answer = await ask("drive", {forward: 0, left: 0, ticket: 0});
    if (answer.ok) return;
    if (!hand.holds) say(sentence("not done: " + answer.message));
  }
}
