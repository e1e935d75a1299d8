// The time line: spans of faults, marks of crashes, broken contracts and what is not judged above the slider.
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
      : kind === 'up' ? floor.c.accent : kind === 'unjudged' ? floor.c.warn : floor.c.dim;
    const whole = kind === 'violation' || kind === 'unjudged';
    g.fillRect(x(t) - px, whole ? 0 : 10 * px, 2 * px, whole ? h : h - 10 * px);
  }
}
