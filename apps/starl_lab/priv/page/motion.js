// Motion in closed form, as in starl_trajectory: pieces of constant speed and turn rate, and ramps.
// A piece is the tail of a row: [0, T0, X, Y, Heading, V, W] or
// [1, T0, X, Y, Heading, VX0, VY0, VX1, VY1, Us]; mm, radians, microseconds.

const sinc = u => Math.abs(u) < 1e-4 ? 1 - u * u / 6 : Math.sin(u) / u;

export function pose(p, t) {
  const s = (t - p[1]) / 1e6;
  return p[0] === 0 ? onArc(p, s) : onRamp(p, s);
}

function onArc([, , x, y, heading, v, w], s) {
  const half = w * s / 2, chord = v * s * sinc(half);
  return [x + chord * Math.cos(heading + half), y + chord * Math.sin(heading + half), heading + w * s];
}

function onRamp([, , x, y, heading, vx0, vy0, vx1, vy1, us], s) {
  const even = Math.min(s, us / 1e6), part = us === 0 ? 0 : even * 1e6 / us / 2, rest = s - even;
  return [x + even * (vx0 + part * (vx1 - vx0)) + rest * vx1,
    y + even * (vy0 + part * (vy1 - vy0)) + rest * vy1, heading];
}

// Points of the way between two times, near enough for a screen.
export function way(p, from, to) {
  const bent = p[0] === 1 ? p[9] > 0 : p[5] !== 0 && p[6] !== 0;
  const n = bent ? Math.max(1, Math.min(24, Math.ceil((to - from) / 60000))) : 1;
  const points = [];
  for (let i = 0; i <= n; i++) points.push(pose(p, from + (to - from) * i / n));
  return points;
}
