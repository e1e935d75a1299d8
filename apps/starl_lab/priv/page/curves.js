// The curves of a measure over the whole run: a line for each robot, and the same at the moment shown as text.
import { last } from './model.js';
import { seconds } from './time.js';

const short = value => Math.abs(value) >= 1e5 || value !== 0 && Math.abs(value) < 1e-3
  ? value.toExponential(2) : String(Number(value.toPrecision(5)));

// Draws the curves; gives the values at the moment in words.
export function curves(canvas, floor, team, key, t, selected) {
  const g = canvas.getContext('2d'), px = window.devicePixelRatio || 1;
  const w = canvas.width = Math.round(canvas.clientWidth * px);
  const h = canvas.height = Math.round(canvas.clientHeight * px);
  const lines = [...team.robots.values()].filter(robot => robot.measures.has(key))
    .map(robot => ({ id: robot.id, values: robot.measures.get(key) }));
  const all = lines.flatMap(({ values }) => values);
  if (!all.length) return '';
  const from = Math.min(...[team.from, all[0][0]]), to = Math.max(from + 1, team.until);
  let [low, high] = all.reduce(([a, b], [, v]) => [Math.min(a, v), Math.max(b, v)], [Infinity, -Infinity]);
  if (low === high) [low, high] = [low - 1, high + 1];
  g.font = `${11 * px}px system-ui, sans-serif`;
  const left = 8 * px + Math.max(g.measureText(short(low)).width, g.measureText(short(high)).width), pad = 7 * px;
  const x = us => left + (w - left - pad) * (us - from) / (to - from);
  const y = value => h - pad - (h - 2 * pad) * (value - low) / (high - low);
  g.fillStyle = floor.c.dim;
  g.textAlign = 'right';
  g.textBaseline = 'middle';
  for (const value of [low, high]) g.fillText(short(value), left - 4 * px, y(value));
  g.strokeStyle = floor.c.line;
  g.lineWidth = px;
  for (const value of [low, high]) stroke(g, [[left, y(value)], [w - pad, y(value)]]);
  // the selected robot's line lies above the others
  for (const { id, values } of lines.sort((a, b) => (a.id === selected) - (b.id === selected))) {
    g.strokeStyle = floor.colour(id);
    g.globalAlpha = selected && id !== selected ? 0.35 : 1;
    g.lineWidth = (id === selected ? 2.5 : 1.2) * px;
    stroke(g, values.map(([us, value]) => [x(us), y(value)]));
    if (values.length === 1) g.strokeRect(x(values[0][0]) - px, y(values[0][1]) - px, 2 * px, 2 * px);
  }
  g.globalAlpha = 1;
  g.strokeStyle = floor.c.warn;
  g.lineWidth = px;
  g.setLineDash([4 * px, 3 * px]);
  stroke(g, [[x(t), 0], [x(t), h]]);
  g.setLineDash([]);
  return said(lines, t, selected);
}

function stroke(g, points) {
  g.beginPath();
  points.forEach(([a, b], i) => i ? g.lineTo(a, b) : g.moveTo(a, b));
  g.stroke();
}

function said(lines, t, selected) {
  const now = lines.map(({ id, values }) => ({ id, at: last(values, t), values })).filter(({ at }) => at >= 0)
    .map(({ id, at, values }) => ({ id, value: values[at][1] }));
  if (!now.length) return `nothing is measured until ${seconds(t)}`;
  const sorted = now.map(({ value }) => value).sort((a, b) => a - b), own = now.find(({ id }) => id === selected);
  const median = sorted[(sorted.length - 1) >> 1];
  const team = sorted.length === 1 ? `robot ${now[0].id}: ${short(sorted[0])}`
    : `${sorted.length} robots: ${short(sorted[0])} to ${short(sorted.at(-1))}, median ${short(median)}`;
  return own && sorted.length > 1 ? `robot ${own.id}: ${short(own.value)} · ${team}` : team;
}
