// Small helpers for elements and words.

export const $ = id => document.getElementById(id);

export function element(kind, words = "", properties = {}) {
  return Object.assign(document.createElement(kind), {textContent: words}, properties);
}

// A list whose items are the parts of each entry; nothing changes on the page while the words stay the same. With a
// key, the item of an entry stays, and its buttons with it, when other parts of it change.
export function lines(id, list, parts, key = null) {
  const made = list.map(entry => {
    const item = document.createElement("li");
    item.append(...parts(entry));
    return Object.assign(item, {key: key && key(entry)});
  });
  const told = made.map(item => item.outerHTML).join("");
  if ($(id).told === told) return;
  $(id).told = told;
  const before = key ? [...$(id).children] : [],
    items = made.map(item => renewed(before.find(old => old.key === item.key), item));
  for (const old of [...$(id).children]) if (!items.includes(old)) old.remove();
  items.forEach((item, i) => {
    if ($(id).children[i] !== item) $(id).insertBefore(item, $(id).children[i] || null);
  });
}

function renewed(old, made) {
  const before = old ? [...old.childNodes] : [],
    parts = [...made.childNodes];
  if (before.map(part => part.nodeName).join() !== parts.map(part => part.nodeName).join()) return made;
  before.forEach((part, i) => part.nodeName === "BUTTON" || part.replaceWith(parts[i]));
  return old;
}

export function pill(id, words, kind) {
  $(id).textContent = words;
  $(id).className = "pill " + kind;
}

export function sentence(words) {
  return words ? words[0].toUpperCase() + words.slice(1) + (/[.!?]$/.test(words) ? "" : ".") : "";
}

export const fixed = (value, digits) => (value == null ? "–" : value.toFixed(digits));

// A canvas at the screen's resolution: its pen, width and height in CSS pixels, emptied.
export function sized(canvas) {
  const scale = window.devicePixelRatio || 1,
    w = canvas.clientWidth,
    h = canvas.clientHeight;
  if (canvas.width !== Math.round(w * scale) || canvas.height !== Math.round(h * scale)) {
    canvas.width = Math.round(w * scale);
    canvas.height = Math.round(h * scale);
  }
  const pen = canvas.getContext("2d");
  pen.setTransform(scale, 0, 0, scale, 0, 0);
  pen.clearRect(0, 0, w, h);
  return [pen, w, h];
}

// The colours of the style sheet, by name ("map-free"); they follow the system's light or dark.
const inks = new Map(),
  dark = matchMedia("(prefers-color-scheme: dark)");
export function ink(name) {
  if (!inks.has(name))
    inks.set(
      name,
      getComputedStyle(document.documentElement)
        .getPropertyValue("--" + name)
        .trim(),
    );
  return inks.get(name);
}
export function onScheme(act) {
  dark.addEventListener("change", () => {
    inks.clear();
    act();
  });
}
