// The time line: spans of faults, marks of crashes and broken contracts above the slider.
export function marks(canvas, floor, team, from, end) {
  const g = canvas.getContext('2d'), px = window.devicePixelRatio || 1;
  const w = canvas.width = Math.round(canvas.clientWidth * px);
  const h = canvas.height = Math.round(canvas.clientHeight * px);
  const pad = 8 * px, span = Math.max(1, end - from);
  const x = t => pad + (w - 2 * pad) * Math.max(0, Math.min(1, (t - from) / span));
  let row = 0;
  for (const fault of team.faults.values()) {
    if (fault.from > end || fault.to < from) continue;
    g.fillStyle = floor.c.warn;
    g.fillRect(x(fault.from), 2 * px + (row++ % 4) * 4 * px, Math.max(3 * px, x(fault.to) - x(fault.from)), 3 * px);
  }
  for (const [t, kind] of team.marks) {
    g.fillStyle = kind === 'violation' || kind === 'died' ? floor.c.bad
      : kind === 'up' ? floor.c.accent : floor.c.dim;
    g.fillRect(x(t) - px, kind === 'violation' ? 0 : 10 * px, 2 * px, kind === 'violation' ? h : h - 10 * px);
  }
}
