// The sheet at the bottom of the map: one matter at a time, closed by its cross or by Escape.
import {$, element} from "./dom.js";
import {showAbove} from "./map.js";

let closed = () => {};

// parts: elements and words; onClose: what ends with it.
export function openSheet(parts, onClose = () => {}) {
  leave();
  closed = onClose;
  const cross = element("button", "×", {className: "cross", title: "Close (Escape)"});
  cross.setAttribute("aria-label", "Close");
  cross.addEventListener("click", closeSheet);
  $("sheet").replaceChildren(cross, ...parts);
  $("sheet").hidden = false;
  $("sheet").scrollIntoView({block: "nearest"});
}

export function closeSheet() {
  leave();
  showAbove(null);
}

function leave() {
  const end = closed;
  closed = () => {};
  $("sheet").hidden = true;
  end();
}

document.addEventListener("keydown", event => {
  if (event.key === "Escape" && !$("sheet").hidden) closeSheet();
});

export function button(words, act, properties = {}) {
  const made = element("button", words, properties);
  made.addEventListener("click", act);
  return made;
}

// A button that asks once more before it acts.
export function askingButton(words, sure, act) {
  const made = button(words, () => {
    if (made.textContent === sure) {
      made.textContent = words;
      act();
      return;
    }
    made.textContent = sure;
    setTimeout(() => {
      made.textContent = words;
    }, 4000);
  });
  return made;
}

export function row(...parts) {
  const made = element("div", "", {className: "row"});
  made.append(...parts);
  return made;
}
