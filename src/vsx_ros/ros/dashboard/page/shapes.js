// Polygons and lines on the floor; points are [x, y] in metres.

export function contains(corners, x, y) {
  // by the even-odd rule
  let inside = false;
  corners.forEach(([ax, ay], i) => {
    const [bx, by] = corners[(i + 1) % corners.length];
    if (ay > y !== by > y && x < ax + ((bx - ax) * (y - ay)) / (by - ay)) inside = !inside;
  });
  return inside;
}

export function distance(line, x, y) {
  // to the nearest point of an open line
  let least = Infinity;
  for (let i = 1; i < line.length; i++) {
    const [ax, ay] = line[i - 1],
      dx = line[i][0] - ax,
      dy = line[i][1] - ay,
      length2 = dx * dx + dy * dy;
    const share = length2 ? Math.min(1, Math.max(0, ((x - ax) * dx + (y - ay) * dy) / length2)) : 0;
    least = Math.min(least, Math.hypot(x - ax - share * dx, y - ay - share * dy));
  }
  return least;
}
