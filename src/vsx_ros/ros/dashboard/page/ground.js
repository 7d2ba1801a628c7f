// The ground map as two pictures, free ground and walls, each in one colour of the style sheet.
import {$, ink, onScheme} from "./dom.js";
import {hear} from "./robot.js";
import {redraw, show, toScreen, view} from "./map.js";

const WALL_LEVEL = 160; // in the picture of the robot walls are light, free ground is dark, the unknown is transparent
export const ground = {free: null, walls: null, x: 0, y: 0, resolution: 0.05};
let cells = null;

hear("map", map => {
  const image = new Image();
  image.onload = () => {
    const {width, height} = image,
      canvas = new OffscreenCanvas(width, height),
      pen = canvas.getContext("2d");
    pen.drawImage(image, 0, 0);
    cells = pen.getImageData(0, 0, width, height);
    Object.assign(ground, {x: map.x, y: map.y, resolution: map.resolution});
    tint();
    show(map.x, map.y, map.x + width * map.resolution, map.y + height * map.resolution);
    redraw();
  };
  image.src = "data:image/png;base64," + map.png;
  $("known").textContent = map.known_m2.toFixed(1) + " m² known";
});
onScheme(() => {
  tint();
  redraw();
});

function tint() {
  if (!cells) return;
  ground.free = picture(ink("map-free"), red => red < WALL_LEVEL);
  ground.walls = picture(ink("map-wall"), red => red >= WALL_LEVEL);
}

function picture(colour, belongs) {
  const canvas = new OffscreenCanvas(cells.width, cells.height),
    pen = canvas.getContext("2d");
  const made = pen.createImageData(cells.width, cells.height),
    [r, g, b] = [1, 3, 5].map(i => parseInt(colour.slice(i, i + 2), 16));
  for (let i = 0; i < cells.data.length; i += 4) {
    if (cells.data[i + 3] && belongs(cells.data[i])) made.data.set([r, g, b, 255], i);
  }
  pen.putImageData(made, 0, 0);
  return canvas;
}

// One of the two pictures, in its place on the map.
export function lay(pen, picture) {
  if (!picture) return;
  const side = ground.resolution * view.pxPerM,
    [x, y] = toScreen(ground.x, ground.y + picture.height * ground.resolution);
  pen.imageSmoothingEnabled = side < 1;
  pen.drawImage(picture, x, y, picture.width * side, picture.height * side);
}
