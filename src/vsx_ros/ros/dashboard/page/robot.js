// The robot at the other end: what it tells (a stream of subjects), and commands to it.
import {$, sentence} from "./dom.js";

const token = location.hash.slice(1);
window.addEventListener("hashchange", () => location.reload()); // another token was typed in
export const known = {}; // the newest word on each subject
export const link = {path: "", heard: 0, refused: ""}; // of the stream; when the last word came, and why none comes
const hearers = {};
const pending = new Set(); // of commands without an answer yet
let stream = null;

export function hear(subject, act) {
  (hearers[subject] ||= []).push(act);
}

export function tell(subject, word) {
  known[subject] = word;
  for (const act of hearers[subject] || []) act(word);
}

// Not an EventSource: that shows no token, which makes this viewer the operator's.
export async function connect(path) {
  if (stream) stream.abort();
  const here = (stream = new AbortController());
  link.path = path;
  try {
    const reply = await fetch(path, {headers: {"X-Vsx-Token": token}, signal: here.signal});
    link.refused = reply.ok ? "" : (await reply.json()).message;
    if (reply.ok) await listen(reply.body.pipeThrough(new TextDecoderStream()).getReader());
  } catch (error) {
    if (!here.signal.aborted) console.error(error);
  }
  if (!here.signal.aborted)
    setTimeout(() => {
      if (stream === here) connect(path);
    }, 1000);
}

async function listen(reader) {
  for (let rest = ""; ;) {
    const {done, value} = await reader.read();
    if (done) return;
    const notes = (rest + value).split("\n\n");
    rest = notes.pop();
    for (const note of notes) {
      const [subject, text] = note.split("\n").map(line => line.slice(line.indexOf(" ") + 1));
      link.heard = performance.now();
      tell(subject, JSON.parse(text));
    }
  }
}

// Whether commands are obeyed; and whether they make sense: not after the end of the run.
export const isOperator = () => known.operator ?? token !== "";
export const mayCommand = () => isOperator() && !known.end;

// Send a command, with a value if it takes one; returns {ok, message, data}. A browser opens only six connections to a
// server, so the emergency stop gives up whatever still waits for an answer.
export async function ask(name, value, controller = new AbortController()) {
  const text = value === undefined ? "" : "?" + encodeURIComponent(JSON.stringify(value)),
    {signal} = controller;
  if (name === "estop") for (const other of pending) other.abort();
  pending.add(controller);
  try {
    const reply = await fetch("/command/" + name + text, {method: "POST", headers: {"X-Vsx-Token": token}, signal});
    return await reply.json();
  } catch (error) {
    return {ok: false, message: "there is no connection to the robot", aborted: signal.aborted};
  } finally {
    pending.delete(controller);
  }
}

// The same, and say what came of it.
export async function command(name, value) {
  say("…");
  const answer = await ask(name, value);
  if (!answer.aborted) say(sentence((answer.ok ? "" : "not done: ") + answer.message));
  return answer;
}

let fading = 0;
export function say(words, stays = false) {
  $("said").textContent = words;
  $("said").classList.add("shown");
  clearTimeout(fading);
  if (!stays) fading = setTimeout(() => $("said").classList.remove("shown"), 8000);
}
