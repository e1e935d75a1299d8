// Draws the floor at a moment. Coordinates are those of the floor: mm, y up.
import { way } from './motion.js';
import { last } from './model.js';

const PALETTE = ['#e6194b', '#3cb44b', '#4363d8', '#f58231', '#78005a', '#00b4ff', '#ff00ff', '#5a5a0f',
  '#00d2b4', '#5a0000', '#c3b400', '#0000ff', '#ff9696', '#006969', '#ff00a5', '#ff96f0'];
const DARK = ['#ff5c7f', '#5fd46e', '#7d97ff', '#ff9c57', '#d06ab4', '#45c8ff', '#ff6bff', '#b9b958',
  '#27e3c8', '#d46a6a', '#e6d632', '#7a7aff', '#ffb0b0', '#4fc3c3', '#ff5cc4', '#ffb3f4'];
const WAY_US = 15e6, LOST_US = 6e5;
// The picture shows at least as much as three robots side by side, at most as much as six floors. A robot
// with a larger radius (pixels of the screen) is drawn anew in each frame; there is room for a few such only.
const LEAST_ROBOTS = 3, MOST_FLOORS = 6, MOST_SPRITE = 48;
// Without a choice of the user the picture holds robots up to this part of the floor outside of it.
const MOST_OUTSIDE = 1, OUTSIDE_STEP = 1 / 8;
// The arrows at the edge that name their robots.
const MOST_NAMED = 12;

export class Floor {
  constructor(canvas, team) {
    this.canvas = canvas;
    this.team = team;
    this.context = canvas.getContext('2d');
    this.inkLayer = document.createElement('canvas');
    this.inked = { until: -1, key: '' };
    this.groundLayer = document.createElement('canvas');
    this.grounded = '';
    this.view = null;       // { x, y, scale }: the middle of the picture, pixels per mm
    this.show = { tubes: true, ink: true, ways: true, packets: true, spots: true, range: false };
    this.dark = matchMedia('(prefers-color-scheme: dark)');
    this.colours();
    this.dark.addEventListener('change', () => this.colours());
  }
  colours() {
    const style = getComputedStyle(document.documentElement);
    this.css = name => style.getPropertyValue(name).trim();
    this.palette = this.dark.matches ? DARK : PALETTE;
    this.c = Object.fromEntries(['floor', 'grid', 'todo', 'text', 'dim', 'bad', 'warn', 'accent', 'dead',
      'line', 'paper'].map(name => [name, this.css('--' + name)]));
    this.inked.key = this.grounded = '';
    this.sprites = new Map();
    this.spriteRadius = 0;
  }
  colour(id) { return this.palette[(id - 1) % 16]; }
  // The whole floor, and the robots that have left it, unless the user has chosen a part.
  fit(poses = this.team.poses(this.t ?? 0)) {
    const [left, bottom, right, top] = this.bounds(poses);
    const scale = 0.96 * Math.min(this.w / (right - left), this.h / (top - bottom));
    this.view = { x: (left + right) / 2, y: (bottom + top) / 2, scale, own: false };
  }
  // In steps, so that the picture does not move with each robot.
  bounds(poses) {
    const [width, height] = this.team.run.world;
    const out = (mm, size) => mm <= 0 ? 0
      : size * Math.min(MOST_OUTSIDE, OUTSIDE_STEP * Math.ceil(mm / size / OUTSIDE_STEP));
    let [left, bottom, right, top] = [0, 0, 0, 0];
    for (const [, x, y] of poses) {
      left = Math.max(left, out(-x, width));
      right = Math.max(right, out(x - width, width));
      bottom = Math.max(bottom, out(-y, height));
      top = Math.max(top, out(y - height, height));
    }
    return [-left, -bottom, width + right, height + top];
  }
  isOutside(x, y) {
    const [width, height] = this.team.run.world;
    return x < 0 || y < 0 || x > width || y > height;
  }
  limits() {
    const [width, height] = this.team.run.world;
    const all = Math.min(this.w / width, this.h / height);
    return [all / MOST_FLOORS,
      Math.max(MOST_FLOORS * all, Math.min(this.w, this.h) / (2 * LEAST_ROBOTS * this.team.run.radius))];
  }
  resize() {
    const ratio = window.devicePixelRatio || 1;
    const w = Math.round(this.canvas.clientWidth * ratio), h = Math.round(this.canvas.clientHeight * ratio);
    if (w !== this.canvas.width || h !== this.canvas.height) {
      this.canvas.width = this.inkLayer.width = this.groundLayer.width = w;
      this.canvas.height = this.inkLayer.height = this.groundLayer.height = h;
      this.inked.key = this.grounded = '';
      if (this.view && !this.view.own) this.view = null;
    }
    [this.w, this.h, this.ratio] = [w, h, ratio];
    if (!this.view) this.fit();
  }
  x(mm) { return this.w / 2 + (mm - this.view.x) * this.view.scale; }
  y(mm) { return this.h / 2 - (mm - this.view.y) * this.view.scale; }
  place(px, py) {
    return [(px * this.ratio - this.w / 2) / this.view.scale + this.view.x,
      (this.h / 2 - py * this.ratio) / this.view.scale + this.view.y];
  }
  zoom(factor, px, py) {
    if (!this.view) return;
    const [x, y] = px === undefined ? [this.view.x, this.view.y] : this.place(px, py);
    const [least, most] = this.limits(), before = this.view.scale;
    const scale = Math.max(least, Math.min(most, before * factor)), by = scale / before;
    this.look(x + (this.view.x - x) / by, y + (this.view.y - y) / by, scale);
  }
  move(px, py) {
    if (!this.view) return;
    const { x, y, scale } = this.view;
    this.look(x - px * this.ratio / scale, y + py * this.ratio / scale, scale);
  }
  // The user's own part of the floor: its middle is never farther away than a robot that is shown.
  look(x, y, scale) {
    const [width, height] = this.team.run.world, within = (v, size) =>
      Math.max(-MOST_OUTSIDE * size, Math.min((1 + MOST_OUTSIDE) * size, v));
    this.view = { x: within(x, width), y: within(y, height), scale, own: true };
  }
  // The robot at a place of the picture.
  robotAt(px, py, t) {
    const [x, y] = this.place(px, py);
    let best = null, least = Math.max(this.team.run.radius, 14 * this.ratio / this.view.scale);
    for (const [id, rx, ry] of this.team.poses(t)) {
      const distance = Math.hypot(rx - x, ry - y);
      if (distance < least) [best, least] = [id, distance];
    }
    return best;
  }

  draw(t, selected) {
    const { context: g, team } = this;
    if (!team.run) return;
    this.t = t;
    const poses = team.poses(t), at = new Map(poses.map(p => [p[0], p]));
    this.resize();
    if (!this.view.own) this.fit(poses);
    g.setTransform(1, 0, 0, 1, 0, 0);
    this.still();
    g.clearRect(0, 0, this.w, this.h);
    g.drawImage(this.groundLayer, 0, 0);
    if (this.show.tubes) this.tubes(g, t);
    if (this.show.ink) this.ink(g, t);
    this.drawings(g, t);
    if (this.show.ways && poses.length <= 200) this.ways(g, t);
    this.obstacles(g, t);
    this.cuts(g, t, at);
    if (this.show.packets) this.packets(g, t, at);
    this.robots(g, t, poses.filter(([, x, y]) => this.isSeen(x, y)), selected);
    this.arrows(g, poses.filter(([, x, y]) => this.isOutside(x, y) && !this.isSeen(x, y)));
  }
  // Is a robot at this place in the picture, with the rings around it?
  isSeen(x, y) {
    const around = this.team.run.radius * this.view.scale + 12 * this.ratio, px = this.x(x), py = this.y(y);
    return px > -around && py > -around && px < this.w + around && py < this.h + around;
  }
  // A line of several pieces; one that is outside of the picture is left out.
  lineOf(g, points) {
    let [left, bottom, right, top] = [Infinity, Infinity, -Infinity, -Infinity];
    for (const [x, y] of points) {
      left = Math.min(left, x); right = Math.max(right, x);
      bottom = Math.min(bottom, y); top = Math.max(top, y);
    }
    const half = g.lineWidth;
    if (this.x(right) < -half || this.x(left) > this.w + half || this.y(bottom) < -half ||
        this.y(top) > this.h + half) return;
    g.moveTo(this.x(points[0][0]), this.y(points[0][1]));
    for (let i = 1; i < points.length; i++) g.lineTo(this.x(points[i][0]), this.y(points[i][1]));
  }
  // What does not move is drawn once, on a layer of its own.
  still() {
    const { view } = this, { run } = this.team;
    const key = [view.x, view.y, view.scale, this.show.spots, this.team.version].join();
    if (key === this.grounded && run === this.groundOf) return;
    [this.grounded, this.groundOf] = [key, run];
    const g = this.groundLayer.getContext('2d');
    g.clearRect(0, 0, this.w, this.h);
    this.ground(g);
  }
  ground(g) {
    const { run } = this.team, [width, height] = run.world, px = this.ratio;
    g.fillStyle = this.c.floor;
    g.fillRect(this.x(0), this.y(height), width * this.view.scale, height * this.view.scale);
    g.lineWidth = px;
    g.strokeStyle = this.c.grid;
    g.beginPath();
    const step = this.view.scale * 1000 > 12 ? 1000 : 10000;
    for (let x = 0; x <= width; x += step) this.lineOf(g, [[x, 0], [x, height]]);
    for (let y = 0; y <= height; y += step) this.lineOf(g, [[0, y], [width, y]]);
    g.stroke();
    if (run.plan) this.plan(g, run.plan, px);
    g.lineWidth = px;
    g.strokeStyle = this.c.todo;
    g.beginPath();
    for (const [x1, y1, x2, y2] of run.lines) this.lineOf(g, [[x1, y1], [x2, y2]]);
    g.stroke();
    if (this.show.spots) this.spots(g, run, px);
  }
  // The walls of the floor plan, its doors and the names of its rooms.
  plan(g, { walls, doors, rooms }, px) {
    g.fillStyle = g.strokeStyle = this.c.dim;
    g.lineWidth = 2 * px;
    for (const wall of walls) {
      g.beginPath();
      this.lineOf(g, wall.length > 2 ? [...wall, wall[0]] : wall);
      if (wall.length > 2) g.fill(); else g.stroke();
    }
    g.lineWidth = 1.5 * px;
    g.strokeStyle = this.c.warn;
    g.setLineDash([5 * px, 4 * px]);
    g.beginPath();
    for (const [x1, y1, x2, y2] of doors) this.lineOf(g, [[x1, y1], [x2, y2]]);
    g.stroke();
    g.setLineDash([]);
    g.fillStyle = this.c.dim;
    g.font = `${14 * px}px system-ui, sans-serif`;
    g.textAlign = 'center';
    g.textBaseline = 'middle';
    for (const [name, x, y] of rooms) g.fillText(name, this.x(x), this.y(y));
  }
  // Doors that are closed now, and boxes that stand there.
  obstacles(g, t) {
    const plan = this.team.run.plan;
    if (!plan) return;
    g.lineWidth = 4 * this.ratio;
    g.strokeStyle = this.c.bad;
    g.beginPath();
    for (const { floor } of this.team.holding(t)) {
      if (!floor) continue;
      if (floor.length === 1) {
        const [x1, y1, x2, y2] = plan.doors[floor[0] - 1] || [0, 0, 0, 0];
        this.lineOf(g, [[x1, y1], [x2, y2]]);
      } else {
        const [x, y, w, h] = floor;
        this.lineOf(g, [[x, y], [x + w, y], [x + w, y + h], [x, y + h], [x, y]]);
      }
    }
    g.stroke();
  }
  spots(g, run, px) {
    g.fillStyle = g.strokeStyle = this.c.todo;
    g.font = `${11 * px}px system-ui, sans-serif`;
    g.textAlign = 'center';
    g.textBaseline = 'middle';
    g.beginPath();
    for (const [, x, y] of run.spots) {
      if (!this.isSeen(x, y)) continue;
      const r = Math.max(2, run.radius * this.view.scale);
      g.moveTo(this.x(x) + r, this.y(y));
      g.arc(this.x(x), this.y(y), r, 0, 7);
    }
    if (run.spots.length <= 200) g.setLineDash([3 * px, 3 * px]);
    g.stroke();
    g.setLineDash([]);
    for (const [name, x, y] of run.waypoints) {
      if (!this.isSeen(x, y)) continue;
      g.fillRect(this.x(x) - 3 * px, this.y(y) - 3 * px, 6 * px, 6 * px);
      g.fillText(name, this.x(x), this.y(y) - 10 * px);
    }
  }
  tubes(g, t) {
    const radius = this.team.run.tube;
    if (!radius) return;
    g.lineCap = g.lineJoin = 'round';
    g.lineWidth = 2 * radius * this.view.scale;
    for (const robot of this.team.robots.values()) {
      const tubes = robot.tubes(t);
      if (!tubes.length) continue;
      g.globalAlpha = 0.14;
      g.strokeStyle = this.colour(robot.id);
      g.beginPath();
      for (const [x1, y1, x2, y2] of tubes) this.lineOf(g, [[x1, y1], [x2 + 0.01, y2]]);
      g.stroke();
    }
    g.globalAlpha = 1;
    g.lineCap = 'butt';
  }
  // What applications draw.
  drawings(g, t) {
    const px = this.ratio;
    g.font = `${13 * px}px system-ui, sans-serif`;
    g.textAlign = 'left';
    g.textBaseline = 'alphabetic';
    for (const robot of this.team.robots.values())
      for (const { kind, colour, points, text } of robot.drawings(t)) {
        g.fillStyle = g.strokeStyle = colour === 'own' ? this.colour(robot.id) : colour;
        g.lineWidth = 1.5 * px;
        if (kind === 'text') { g.fillText(text, this.x(points[0]), this.y(points[1])); continue; }
        g.beginPath();
        for (let i = 0; i < points.length; i += 2) {
          const [x, y] = [this.x(points[i]), this.y(points[i + 1])];
          if (kind === 'points') { g.moveTo(x + 4 * px, y); g.arc(x, y, 4 * px, 0, 7); }
          else if (i === 0) g.moveTo(x, y);
          else g.lineTo(x, y);
        }
        if (kind === 'points') { g.fill(); continue; }
        if (kind === 'line') g.setLineDash([5 * px, 4 * px]);
        else {
          g.closePath();
          g.globalAlpha = 0.15;
          g.fill();
          g.globalAlpha = 1;
        }
        g.stroke();
        g.setLineDash([]);
      }
  }
  // Ink only grows, so it is drawn once, on a layer of its own.
  ink(g, t) {
    const layer = this.inkLayer.getContext('2d'), { view } = this;
    const key = [this.w, this.h, view.x, view.y, view.scale, this.team.version].join();
    let { until } = this.inked;
    if (key !== this.inked.key || t < until) {
      layer.clearRect(0, 0, this.w, this.h);
      until = this.team.begin;
      this.old(layer);
    }
    layer.lineWidth = Math.max(2 * this.ratio, 25 * view.scale);
    layer.lineCap = layer.lineJoin = 'round';
    for (const robot of this.team.robots.values()) {
      if (!robot.pen.length) continue;
      layer.strokeStyle = this.colour(robot.id);
      layer.beginPath();
      robot.strokes(until, t, points => this.lineOf(layer, points));
      layer.stroke();
    }
    this.inked = { key, until: t };
    g.drawImage(this.inkLayer, 0, 0);
  }
  old(layer) {
    layer.lineWidth = Math.max(2 * this.ratio, 25 * this.view.scale);
    for (const [, robot, flat] of this.team.ink) {
      const points = [];
      for (let i = 0; i < flat.length; i += 2) points.push([flat[i], flat[i + 1]]);
      layer.strokeStyle = this.colour(robot);
      layer.beginPath();
      this.lineOf(layer, points);
      layer.stroke();
    }
  }
  ways(g, t) {
    g.lineWidth = this.ratio;
    g.globalAlpha = 0.5;
    for (const robot of this.team.robots.values()) {
      const { motions } = robot, from = t - WAY_US;
      g.strokeStyle = this.colour(robot.id);
      g.beginPath();
      for (let i = last(motions, t); i >= 0; i--) {
        const until = Math.min(t, i + 1 < motions.length ? motions[i + 1][0] : t);
        if (until < from) break;
        const p = motions[i][1];
        if (p[0] === 1 || p[5] !== 0) this.lineOf(g, way(p, Math.max(from, motions[i][0]), until));
      }
      g.stroke();
    }
    g.globalAlpha = 1;
  }
  // Cut links, partitions, robots that are alone.
  cuts(g, t, at) {
    const holding = this.team.holding(t).filter(f => ['loss', 'drop', 'partition', 'one_way_partition',
      'isolate', 'burst_loss', 'delay', 'corrupt', 'location_frozen', 'pause'].includes(f.kind));
    g.strokeStyle = this.c.bad;
    g.lineWidth = 1.5 * this.ratio;
    g.setLineDash([6 * this.ratio, 4 * this.ratio]);
    for (const fault of holding) {
      const ids = (fault.target.match(/\d+/g) || []).map(Number).filter(id => at.has(id));
      const link = fault.target.startsWith('{') && ids.length === 2;
      g.beginPath();
      if (link) this.lineOf(g, ids.map(id => at.get(id).slice(1)));
      else for (const id of ids.filter(id => this.isSeen(...at.get(id).slice(1)))) {
        const r = (this.team.run.radius * this.view.scale) + 7 * this.ratio;
        g.moveTo(this.x(at.get(id)[1]) + r, this.y(at.get(id)[2]));
        g.arc(this.x(at.get(id)[1]), this.y(at.get(id)[2]), r, 0, 7);
      }
      g.stroke();
    }
    g.setLineDash([]);
  }
  packets(g, t, at) {
    const { packets } = this.team, px = this.ratio;
    for (let i = last(packets, t), n = 0; i >= 0 && packets[i][0] > t - 1.5e6 && n < 400; i--, n++) {
      const [sent, from, to, what, , , arrives] = packets[i];
      const a = at.get(from), b = at.get(to);
      if (!a || !b) continue;
      if (arrives > t) {
        const part = (t - sent) / Math.max(1, arrives - sent);
        const x = a[1] + (b[1] - a[1]) * part, y = a[2] + (b[2] - a[2]) * part;
        if (!this.isSeen(x, y)) continue;
        g.fillStyle = what.includes('ack') ? this.c.dim : this.c.accent;
        g.fillRect(this.x(x) - 2.5 * px, this.y(y) - 2.5 * px, 5 * px, 5 * px);
      } else if (arrives === 0 && t - sent < LOST_US) {
        g.globalAlpha = 1 - (t - sent) / LOST_US;
        g.strokeStyle = this.c.bad;
        g.lineWidth = 2 * px;
        this.cross(g, this.x((a[1] + b[1]) / 2), this.y((a[2] + b[2]) / 2), 5 * px);
        g.globalAlpha = 1;
      }
    }
  }
  cross(g, x, y, r) {
    g.beginPath();
    g.moveTo(x - r, y - r); g.lineTo(x + r, y + r);
    g.moveTo(x - r, y + r); g.lineTo(x + r, y - r);
    g.stroke();
  }
  robots(g, t, poses, selected) {
    const { run, violations } = this.team, px = this.ratio;
    const r = Math.max(3 * px, run.radius * this.view.scale);
    const broken = new Set(violations.filter(v => v.t <= t).flatMap(v => v.robots));
    if (r < 5 * px) {
      this.crowd(g, t, poses, r, broken, selected);
      return;
    }
    for (const [id, x, y, heading] of poses) {
      const cx = this.x(x), cy = this.y(y), condition = this.team.robots.get(id).condition(t);
      g.translate(cx, cy);
      g.rotate(-heading);
      if (r > MOST_SPRITE * px) this.body(g, id, r, condition);
      else {
        const sprite = this.sprite(id, r, condition);
        g.drawImage(sprite, -sprite.width / 2, -sprite.height / 2);
      }
      g.setTransform(1, 0, 0, 1, 0, 0);
      if (broken.has(id)) this.ring(g, cx, cy, r + 4 * px, this.c.bad);
      if (id === selected) this.around(g, cx, cy, r);
    }
    if (r >= 7 * px) this.numbers(g, poses, r);
  }
  // Very many small robots: those of one colour in one go.
  crowd(g, t, poses, r, broken, selected) {
    const groups = new Map(), px = this.ratio;
    for (const pose of poses) {
      const dead = this.team.robots.get(pose[0]).condition(t) === 'died';
      const key = dead ? this.c.dead : this.colour(pose[0]);
      if (!groups.has(key)) groups.set(key, []);
      groups.get(key).push(pose);
    }
    g.lineWidth = Math.max(1, r / 3);
    for (const [colour, own] of groups) {
      g.fillStyle = g.strokeStyle = colour;
      g.beginPath();
      for (const [, x, y] of own) {
        const cx = this.x(x), cy = this.y(y);
        g.moveTo(cx + r, cy);
        g.arc(cx, cy, r, 0, 7);
      }
      g.fill();
      g.beginPath();
      for (const [, x, y, heading] of own) {
        const cx = this.x(x), cy = this.y(y);
        g.moveTo(cx, cy);
        g.lineTo(cx + 2 * r * Math.cos(heading), cy - 2 * r * Math.sin(heading));
      }
      g.stroke();
    }
    for (const [id, x, y] of poses) {
      if (broken.has(id)) this.ring(g, this.x(x), this.y(y), r + 4 * px, this.c.bad);
      if (id === selected) this.around(g, this.x(x), this.y(y), r);
    }
  }
  around(g, cx, cy, r) {
    this.ring(g, cx, cy, r + 6 * this.ratio, this.c.accent);
    const { range } = this.team.run;
    if (this.show.range && range) this.ring(g, cx, cy, range * this.view.scale, this.c.accent);
  }
  ring(g, cx, cy, r, colour) {
    g.strokeStyle = colour;
    g.lineWidth = 2 * this.ratio;
    g.beginPath();
    g.arc(cx, cy, r, 0, 7);
    g.stroke();
  }
  numbers(g, poses, r) {
    g.fillStyle = '#fff';
    g.font = `600 ${Math.min(14 * this.ratio, r * 1.05)}px system-ui, sans-serif`;
    g.textAlign = 'center';
    g.textBaseline = 'middle';
    g.lineWidth = 2 * this.ratio;
    g.strokeStyle = 'rgba(0,0,0,.6)';
    g.lineJoin = 'round';
    for (const [id, x, y] of poses) {
      g.strokeText(id, this.x(x), this.y(y));
      g.fillText(id, this.x(x), this.y(y));
    }
  }
  // Robots off the floor that the picture does not show: arrows at its edge.
  arrows(g, poses) {
    const px = this.ratio, edge = 14 * px, within = (v, size) => Math.max(edge, Math.min(size - edge, v));
    g.font = `600 ${11 * px}px system-ui, sans-serif`;
    g.textAlign = 'center';
    g.textBaseline = 'middle';
    poses.forEach(([id, x, y], i) => {
      const cx = within(this.x(x), this.w), cy = within(this.y(y), this.h);
      const to = Math.atan2(this.y(y) - cy, this.x(x) - cx), point = (turn, r) =>
        [cx + r * Math.cos(to + turn), cy + r * Math.sin(to + turn)];
      g.fillStyle = this.colour(id);
      g.beginPath();
      g.moveTo(...point(0, 10 * px));
      g.lineTo(...point(2.4, 8 * px));
      g.lineTo(...point(-2.4, 8 * px));
      g.fill();
      g.fillStyle = this.c.text;
      if (i < MOST_NAMED) g.fillText(id, ...point(Math.PI, 16 * px));
    });
  }
  // A robot drawn once for all of its colour and condition, at the present scale only.
  sprite(id, r, condition) {
    if (this.spriteRadius !== r) {
      this.sprites.clear();
      this.spriteRadius = r;
    }
    const key = `${(id - 1) % 16} ${condition}`;
    let sprite = this.sprites.get(key);
    if (sprite) return sprite;
    sprite = document.createElement('canvas');
    sprite.width = sprite.height = Math.ceil(2 * r + 4);
    const g = sprite.getContext('2d');
    g.translate(sprite.width / 2, sprite.height / 2);
    this.body(g, id, r, condition);
    this.sprites.set(key, sprite);
    return sprite;
  }
  // A disc with its heading, crossed out if the robot is dead, hollow if it is down.
  body(g, id, r, condition) {
    g.fillStyle = g.strokeStyle = condition === 'died' ? this.c.dead : this.colour(id);
    g.lineWidth = Math.max(1, r / 6);
    g.beginPath();
    g.arc(0, 0, r - g.lineWidth / 2, 0, 7);
    if (condition === 'down') g.stroke(); else g.fill();
    g.strokeStyle = condition === 'down' ? this.colour(id) : '#fff';
    g.lineWidth = Math.max(1.5, r / 5);
    if (condition === 'died') this.cross(g, 0, 0, r * 0.6);
    else { g.beginPath(); g.moveTo(r * 0.45, 0); g.lineTo(r, 0); g.stroke(); }
  }
}
