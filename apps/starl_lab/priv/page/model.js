// What the page knows of a run: everything that its rows told (see starl_view_row), by time, so that
// any moment of it can be shown. It is bounded: of a very long run the oldest part is forgotten.
import { pose, way } from './motion.js';

const MOST_TOLD = 600000, MOST_PACKETS = 120000, MOST_MARKS = 5000, MOST_FAULTS = 2000, MOST_SENT = 20000,
  MOST_KEYS = 500, MOST_MEASURES = 200, MOST_VALUES = 4000;

// The index of the last entry at or before a time, or -1; entries are [time, ...], ascending.
export function last(entries, t) {
  let low = 0, high = entries.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (entries[middle][0] <= t) low = middle + 1; else high = middle;
  }
  return low - 1;
}

class Robot {
  constructor(id) {
    this.id = id;
    this.motions = [];      // [t, piece]
    this.pen = [];          // [t, down]
    this.held = [];         // [t, lines]
    this.conditions = [];   // [t, up | down | died]
    this.drawn = new Map(); // by key: [t, drawing]
    this.measures = new Map(); // by key: [t, value]
  }
  pose(t) {
    const i = last(this.motions, t);
    return i < 0 ? this.motions.length ? pose(this.motions[0][1], this.motions[0][1][1]) : null
      : pose(this.motions[i][1], t);
  }
  isDown(t) { const i = last(this.pen, t); return i >= 0 && this.pen[i][1]; }
  tubes(t) { const i = last(this.held, t); return i < 0 ? [] : this.held[i][1]; }
  // What its application draws, as of a moment.
  draw(t, key, drawing) {
    if (!this.drawn.has(key)) {
      if (this.drawn.size >= MOST_KEYS) this.drawn.delete(this.drawn.keys().next().value);
      this.drawn.set(key, []);
    }
    this.drawn.get(key).push([t, drawing]);
  }
  drawings(t) {
    const list = [];
    for (const entries of this.drawn.values()) {
      const i = last(entries, t);
      if (i >= 0 && entries[i][1].points.length && (!entries[i][1].life || t < entries[i][0] + entries[i][1].life))
        list.push(entries[i][1]);
    }
    return list;
  }
  // A number that its application measures; of very many each second one is left out.
  measure(t, key, value) {
    if (!this.measures.has(key)) {
      if (this.measures.size >= MOST_MEASURES) return;
      this.measures.set(key, []);
    }
    const values = this.measures.get(key);
    values.push([t, value]);
    if (values.length > MOST_VALUES) this.measures.set(key, values.filter((_, i) => i % 2 === 1 || i === values.length - 1));
  }
  condition(t) { const i = last(this.conditions, t); return i < 0 ? 'up' : this.conditions[i][1]; }
  // The way with the pen down between two times: a function gets each stroke as points.
  strokes(from, to, draw) {
    let at = from;
    let p = last(this.pen, from), m = Math.max(0, last(this.motions, from));
    while (at < to && m < this.motions.length) {
      const nextPen = p + 1 < this.pen.length ? this.pen[p + 1][0] : Infinity;
      const nextMotion = m + 1 < this.motions.length ? this.motions[m + 1][0] : Infinity;
      const until = Math.min(to, nextPen, nextMotion);
      if (until > at && p >= 0 && this.pen[p][1]) {
        const piece = this.motions[m][1];
        if (piece[0] === 1 || piece[5] !== 0) draw(way(piece, Math.max(at, piece[1]), until));
      }
      at = Math.max(at, until);
      if (nextPen <= at) p++;
      if (nextMotion <= at) m++;
      if (until === Infinity) break;
    }
  }
}

export class Team {
  constructor() { this.clear(); this.run = null; this.version = 0; }
  clear() {
    this.robots = new Map();
    this.ink = [];           // [t, robot, [x, y, ...]] from before the page came
    this.packets = [];       // [t, from, to, what, bytes, fate, at]
    this.sent = new Map();   // of messages, by id
    this.told = false;       // are packets told, or messages only?
    this.marks = [];         // [t, kind, text, robots]
    this.faults = new Map();
    this.violations = [];
    this.unjudged = [];      // of some contracts, or of all
    this.begin = 0;
    this.part = false;
    this.now = 0;
    this.count = 0;
    this.leftOut = 0;
    this.clock = {};
    this.version = (this.version || 0) + 1;
  }
  robot(id) {
    let robot = this.robots.get(id);
    if (!robot) this.robots.set(id, robot = new Robot(id));
    return robot;
  }
  // Takes a row; says what it was.
  take(row) {
    const [kind, t] = row;
    switch (kind) {
      case 'm': this.robot(row[2]).motions.push([t, row.slice(3)]); this.trim(++this.count); break;
      case 'a': if (row[3] === 'pen') { this.robot(row[2]).pen.push([t, row[4] === 'down']); this.trim(++this.count); } break;
      case 'r': this.robot(row[2]).held.push([t, row[3]]); this.trim(++this.count); break;
      case 'g': this.robot(row[2]).draw(t, row[3], { kind: row[4], colour: row[5], points: row[6], text: row[7],
        life: row[8] }); this.trim(++this.count); break;
      case 'n': this.robot(row[2]).measure(t, row[3], row[4]); break;
      case 'p': this.told = true; this.packet(row.slice(1)); break;
      case 's': if (this.sent.size >= MOST_SENT) this.sent.clear(); this.sent.set(row[3], t); break;
      case 'd': this.delivered(row); break;
      case 'o': this.outcome(row); break;
      case 'x': this.happened(row); break;
      case 'f': this.oldFaults(); this.faults.set(row[2], { id: row[2], from: row[3] * 1000, to: row[4] * 1000,
        kind: row[5], target: row[6], params: row[7], floor: row[8] }); break;
      case 'end': if (this.faults.has(row[2])) this.faults.get(row[2]).to = t; break;
      case 'v': this.violated(row); break;
      case 'u': this.blinded(row); break;
      case 'i': this.ink.push(row.slice(1)); this.begin = t; this.version++; break;
      case 'c': this.leftOut += row[2]; break;
      case 'gap': this.begin = t; this.version++; break;
      case 'run': this.run = row[1]; break;
      case 'reset': this.clear(); break;
      case 't': if (!this.part) this.now = t; this.clock = row[2]; break;
      // of a long recording the page has a part, to this end
      case 'w': this.part = true; this.now = t; this.clock = row[2]; break;
    }
    return kind;
  }
  packet(packet) {
    this.packets.push(packet);
    if (this.packets.length > MOST_PACKETS) this.packets.splice(0, MOST_PACKETS / 4);
  }
  // Where packets are not told (live, robots), messages stand for them.
  delivered([, t, to, id, type]) {
    const from = Number(id.split('.')[0]), sent = this.sent.get(id);
    if (!this.told && sent !== undefined && from !== to) this.insert([sent, from, to, type, 0, 'delivered', t]);
  }
  outcome([, , from, id, at, outcome]) {
    const sent = this.sent.get(id);
    if (!this.told && outcome === 'lost' && sent !== undefined)
      this.insert([sent, from, at, 'message', 0, 'never acknowledged', 0]);
  }
  insert(packet) {
    this.packets.splice(last(this.packets, packet[0]) + 1, 0, packet);
    if (this.packets.length > MOST_PACKETS) this.packets.splice(0, MOST_PACKETS / 4);
  }
  happened([, t, id, machine, what]) {
    const robot = this.robot(id);
    if (machine === 'robot' && ['up', 'down', 'died'].includes(what)) { robot.conditions.push([t, what]); this.trim(++this.count); }
    if (machine === 'chassis') {
      this.marks.push([t, 'sensed', `robot ${id} feels ${what}`, [id]]);
      if (this.marks.length > MOST_MARKS) this.marks.splice(0, MOST_MARKS / 2);
    } else if (machine === 'robot' || what === 'crashed') {
      this.marks.push([t, what, machine === 'robot' ? `robot ${id} ${what}`
        : `${machine} of robot ${id} crashed`, [id]]);
      if (this.marks.length > MOST_MARKS) this.marks.splice(0, MOST_MARKS / 2);
    }
  }
  violated([, t, contract, text, robots]) {
    if (this.violations.length >= MOST_FAULTS || this.violations.some(v => v.text === text)) return;
    this.violations.push({ t, contract, text, robots });
    this.marks.push([t, 'violation', text, robots]);
    this.marks.sort((a, b) => a[0] - b[0]);
  }
  blinded([, t, contracts, text]) {
    if (this.unjudged.length >= MOST_FAULTS || this.unjudged.some(u => u.text === text)) return;
    this.unjudged.push({ t, contracts, text });
    this.marks.push([t, 'unjudged', text, []]);
    this.marks.sort((a, b) => a[0] - b[0]);
  }
  oldFaults() {
    if (this.faults.size >= MOST_FAULTS) this.faults.delete(this.faults.keys().next().value);
  }
  // Of a run without end the older half is forgotten, and the ink of it with it; what held then is kept.
  trim(count) {
    if (count < MOST_TOLD) return;
    const stores = [...this.robots.values()].flatMap(r => [r.motions, r.pen, r.held, r.conditions,
      ...r.drawn.values()]);
    const times = stores.flatMap(store => store.length > 1 ? [store[store.length >> 1][0]] : []);
    const begin = Math.max(this.begin, ...times);
    for (const store of stores) store.splice(0, Math.max(0, last(store, begin)));
    this.count = stores.reduce((sum, store) => sum + store.length, 0);
    this.begin = begin;
    this.ink = this.ink.filter(([t]) => t >= begin);
    this.version++;
  }
  // The whole run, of which the page of a long recording has a part.
  get from() { return this.run && this.run.kind === 'recording' ? this.run.begun : this.begin; }
  get until() { return Math.max(this.now, this.run && this.run.kind === 'recording' ? this.run.until ?? 0 : 0); }
  poses(t) {
    const poses = [];
    for (const robot of this.robots.values()) {
      const at = robot.pose(t);
      if (at) poses.push([robot.id, ...at]);
    }
    return poses;
  }
  // Packets between two times.
  talk(from, to) {
    const list = [];
    for (let i = last(this.packets, to); i >= 0 && this.packets[i][0] >= from && list.length < 3000; i--)
      list.push(this.packets[i]);
    return list.reverse();
  }
  // The names of what is measured.
  get measured() {
    return [...new Set([...this.robots.values()].flatMap(robot => [...robot.measures.keys()]))].sort();
  }
  holding(t) { return [...this.faults.values()].filter(f => f.from <= t && t < f.to); }
}
