// What happened, newest first: repeats are told once, and time begins with the run, as in the report.
import {element, lines} from "./dom.js";
import {hear, known} from "./robot.js";

const LONGEST_CYCLE = 2; // events that follow each other again and again, as stale and following do
let begun_ns = null;

// Of a cycle of one or two that repeats, only the first ones, each with the number of its repeats and the stamp of the
// last. Reasons that differ in numbers alone count as the same.
export function collapsed(events) {
  const kinds = events.map(event => event.state + "\n" + event.reason.replace(/-?[0-9]+([.][0-9]+)?/g, "#"));
  const told = [];
  for (let at = 0; at < events.length; ) {
    let cycle = 1,
      times = repeats(kinds, at, 1);
    for (let length = 2; length <= LONGEST_CYCLE; length++) {
      const found = repeats(kinds, at, length);
      if (found > 1 && length * found > cycle * times) [cycle, times] = [length, found];
    }
    const last = at + cycle * (times - 1);
    for (let k = 0; k < cycle; k++) told.push({...events[at + k], times, last_ns: events[last + k].stamp_ns});
    at += cycle * times;
  }
  return told;
}

function repeats(kinds, at, cycle) {
  let times = 1;
  const again = () => kinds.slice(at, at + cycle).every((kind, k) => kind === kinds[at + cycle * times + k]);
  while (at + cycle * (times + 1) <= kinds.length && again()) times += 1;
  return times;
}

const seconds = stamp_ns => ((stamp_ns - begun_ns) / 1e9).toFixed(1) + " s";

function show() {
  if (begun_ns === null || !known.events) return;
  const ours = known.events.filter(event => event.stamp_ns >= begun_ns); // not of the run before
  lines("events", collapsed(ours).reverse(), event => [
    element("time", seconds(event.stamp_ns)),
    element("b", event.state),
    event.reason.split(" [")[0] + (event.times > 1 ? ` (${event.times} times until ${seconds(event.last_ns)})` : ""),
  ]);
}

hear("events", show);
hear("mission", mission => {
  if (mission.begun_ns === begun_ns) return;
  begun_ns = mission.begun_ns;
  show();
});
