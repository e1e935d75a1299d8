// The sequence chart: packets around a moment, robots side by side, time downwards; and the same as text.
import { seconds } from './time.js';

const SPAN_US = 6e5, MOST_COLUMNS = 12;

// Draws the chart; `first` is the robot of the first column where there is no room for all. Gives the packets, the
// robots that have a column, and all that have a part in them.
export function chart(canvas, floor, team, t, selected, first) {
  const g = canvas.getContext('2d'), px = window.devicePixelRatio || 1;
  const w = canvas.width = Math.round(canvas.clientWidth * px);
  const h = canvas.height = Math.round(canvas.clientHeight * px);
  const from = t - SPAN_US, to = t + SPAN_US / 4;
  const talk = team.talk(from - 1e6, to)
    .filter(p => !selected || p[1] === selected || p[2] === selected);
  const all = talkers(team, talk, selected), ids = columns(all, selected, first);
  const x = id => 26 * px + (w - 52 * px) * (ids.length < 2 ? 0.5 : ids.indexOf(id) / (ids.length - 1));
  const y = us => 20 * px + (h - 24 * px) * (us - from) / (to - from);
  g.font = `${11 * px}px system-ui, sans-serif`;
  g.textAlign = 'center';
  g.lineWidth = px;
  for (const id of ids) {
    g.strokeStyle = floor.c.line;
    line(g, x(id), 18 * px, x(id), h);
    g.fillStyle = floor.colour(id);
    g.fillText(id, x(id), 13 * px);
  }
  g.strokeStyle = floor.c.warn;
  g.setLineDash([4 * px, 3 * px]);
  line(g, 0, y(t), w, y(t));
  g.setLineDash([]);
  g.beginPath();
  g.rect(0, 18 * px, w, h);
  g.clip();
  for (const [sent, a, b, what, , fate, arrives] of talk) {
    if (!ids.includes(a) || !ids.includes(b)) continue;
    const lost = arrives === 0, end = lost ? sent + 15000 : arrives;
    const part = lost ? 0.6 : 1;
    const ex = x(a) + (x(b) - x(a)) * part;
    g.strokeStyle = g.fillStyle = lost || fate === 'corrupt' ? floor.c.bad
      : what.includes('ack') ? floor.c.dim : floor.c.accent;
    line(g, x(a), y(sent), ex, y(end));
    if (lost) floor.cross(g, ex, y(end), 4 * px);
    else g.fillRect(ex - 2 * px, y(end) - 2 * px, 4 * px, 4 * px);
  }
  return { talk, ids, all };
}

function talkers(team, talk, selected) {
  const ids = new Set(selected ? [selected] : []);
  for (const [, a, b] of talk) { ids.add(a); ids.add(b); }
  if (ids.size < 2) for (const id of (team.run ? team.run.robots : [])) ids.add(id);
  return [...ids].sort((a, b) => a - b);
}

// The selected robot always has a column.
function columns(all, selected, first) {
  if (all.length <= MOST_COLUMNS) return all;
  const others = all.filter(id => id !== selected), room = MOST_COLUMNS - (all.length - others.length);
  const after = others.findIndex(id => id >= first);
  const from = Math.max(0, Math.min(after < 0 ? others.length : after, others.length - room));
  return [...others.slice(from, from + room), ...(selected ? [selected] : [])].sort((a, b) => a - b);
}

function line(g, x1, y1, x2, y2) {
  g.beginPath();
  g.moveTo(x1, y1);
  g.lineTo(x2, y2);
  g.stroke();
}

export function words([t, from, to, what, bytes, fate, arrives]) {
  const end = arrives === 0 ? `lost (${fate})` : `${fate} ${seconds(arrives)}`;
  return `${seconds(t)}: ${from} → ${to}, ${what}, ${bytes ? `${bytes} bytes, ` : ''}${end}`;
}
