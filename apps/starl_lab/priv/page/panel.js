// The panels beside the floor: the selected robot, contracts, faults and what hands can do.
import { words } from './chart.js';
import { seconds } from './time.js';
import { settle } from './settle.js';

const MOST_ROWS = 200, SAID_MS = 12000;

const $ = id => document.getElementById(id);

function element(tag, text, more = {}) {
  const made = document.createElement(tag);
  made.textContent = text;
  for (const [key, value] of Object.entries(more)) made[key] = value;
  return made;
}

// A term on one line, as much of it as there is room for.
function brief(term) {
  const line = String(term).replace(/\s*\n\s*/g, '');
  return line.length > 44 ? `${line.slice(0, 43)}…` : line;
}

export class Panel {
  constructor(team, floor, state, send, select) {
    Object.assign(this, { team, floor, state, send, select, asked: 0, shown: {}, opened: new Set(),
      firstRow: 0 });
    $('fault').onsubmit = event => { event.preventDefault(); this.fault(); };
    $('heal').onclick = () => this.hand({ do: 'heal', id: 'all' }, 'fault');
    $('save').onsubmit = event => {
      event.preventDefault();
      this.say('', 'save');
      this.send({ do: 'save', name: $('name').value, of: 'save' });
    };
    for (const form of ['fault', 'save', 'until']) $(form).addEventListener('input', () => this.say('', form));
    $('rows-back').onclick = () => this.rows(-MOST_ROWS);
    $('rows-on').onclick = () => this.rows(MOST_ROWS);
    $('kind').onchange = () => this.params();
    $('team').ontoggle = () => { this.shown.table = null; };
  }

  began() {
    const kinds = this.team.run.kinds || [], before = $('kind').value;
    settle($('kind'), kinds.map(([kind, , , doc]) => element('option', kind.replaceAll('_', ' '),
      { value: kind, title: doc })));
    if (kinds.some(([kind]) => kind === before)) $('kind').value = before;
    this.params();
    this.shown = {};
    this.firstRow = 0;
    this.selected();
  }

  // The fields of the chosen kind's parameters.
  params() {
    const spec = (this.team.run.kinds || []).find(([kind]) => kind === $('kind').value);
    $('params').replaceChildren(...(spec ? spec[2] : []).map(([key, ...range]) => {
      const label = element('label', `${key} `);
      const field = Array.isArray(range[0]) ? element('select', '') : element('input', '', { type: 'number',
        min: range[0], max: range[1], step: 'any', required: true });
      if (Array.isArray(range[0])) for (const word of range[0]) field.append(element('option', word));
      else field.value = range[1] === 1 ? 0.5 : Math.min(range[1], 100);
      field.name = key;
      label.append(field);
      return label;
    }));
    if (spec) $('kind').title = spec[3];
  }

  fault() {
    const params = {};
    for (const field of $('params').querySelectorAll('[name]'))
      params[field.name] = field.tagName === 'SELECT' ? field.value : Number(field.value);
    const kind = $('kind').value;
    const shape = (this.team.run.kinds.find(([name]) => name === kind) || [])[1];
    const command = { do: 'fault', kind, target: target($('target').value, shape), params };
    if ($('seconds').value !== '') command.seconds = Number($('seconds').value);
    this.hand(command, 'fault');
  }

  // A part of the page asks, and gets the answer.
  hand(command, of = 'robot') {
    this.state.live = true;
    this.say('', of);
    this.send({ ...command, of });
  }

  // Words of the server stand where it was asked, until the next try or for a while.
  say(text, of = '', bad = false, stays = false) {
    const place = $(of ? `${of}-said` : 'news') ?? $('news');
    clearTimeout(place.going);
    place.textContent = text;
    place.classList.toggle('bad', bad);
    if (text && of) place.scrollIntoView({ block: 'nearest' });
    if (text && !stays) place.going = setTimeout(() => { place.textContent = ''; }, SAID_MS);
  }

  // -- the selected robot

  selected() {
    const id = this.state.selected, hands = $('robot-hands');
    this.asked = 0;
    this.say('', 'robot');
    $('machines').replaceChildren();
    $('robot-title').textContent = id === null ? 'Robot' : `Robot ${id}`;
    hands.replaceChildren();
    if (id === null || this.team.run.kind === 'recording') return;
    const act = (text, command, title = '') => {
      const button = element('button', text, { title, onclick: () => this.hand(command()) });
      hands.append(button);
      return button;
    };
    if (this.team.run.kind === 'live') return this.liveHands(id, act);
    act('Kill', () => ({ do: 'fault', kind: 'kill_robot', target: id }), 'the robot dies for good').id = 'kill';
    act('Reboot', () => ({ do: 'fault', kind: 'reboot', target: id, seconds: 3 }), 'down for 3 s').id = 'reboot';
    act('Pause 3 s', () => ({ do: 'fault', kind: 'pause', target: id, seconds: 3 }), 'its computer stands still').id = 'hold';
    act('Freeze positions 5 s', () => ({ do: 'fault', kind: 'location_frozen', target: id, seconds: 5 })).id = 'freeze';
    act('Isolate 5 s', () => ({ do: 'fault', kind: 'isolate', target: id, seconds: 5 })).id = 'isolate';
    const machine = element('select', '', { ariaLabel: 'machine' });
    machine.append(...this.team.run.machines.map(name => element('option', name)));
    hands.append(machine);
    act('Kill machine', () => ({ do: 'fault', kind: 'kill_machine', target: [id, machine.value] })).id = 'kill-machine';
    if (this.team.run.robots.length < 2) return;
    const other = this.other(id);
    hands.append(other);
    act('Cut link', () => ({ do: 'fault', kind: 'cut', target: [id, Number(other.value)] })).id = 'cut';
  }
  liveHands(id, act) {
    const kinds = (this.team.run.kinds || []).map(([kind]) => kind), can = kind => kinds.includes(kind);
    const button = (name, text, kind, more, title = '') => can(kind) &&
      (act(text, () => ({ do: 'fault', kind, target: id, ...more }), title).id = name);
    button('kill', 'Kill', 'reboot', { seconds: 0 }, 'its processes end; it starts anew');
    button('hold', 'Pause 3 s', 'pause', { seconds: 3 }, 'its computer stands still');
    button('lose-store', 'Lose store', 'store_lost', { seconds: 0 }, 'it starts anew without its store');
    button('set-back', 'Set store back', 'store_set_back', { seconds: 0 },
      'it starts anew with its store before its last start');
    button('freeze', 'Freeze positions', 'location_frozen', {});
    if (!can('loss') || this.team.run.robots.length < 2) return;
    const other = this.other(id);
    $('robot-hands').append(other);
    act('Cut link', () => ({ do: 'fault', kind: 'cut', target: [id, Number(other.value)] })).id = 'cut';
  }
  other(id) {
    return element('input', '', { type: 'number', min: 1, max: this.team.run.robots.length,
      ariaLabel: 'other robot', value: id === 1 ? 2 : 1 });
  }

  // The server's answer: all of a robot.
  look(t, id, seen) {
    if (id !== this.state.selected) return;
    for (const details of $('machines').querySelectorAll('details'))
      this.opened[details.open ? 'add' : 'delete'](details.dataset.key);
    const parts = [element('p', seen.told
      ? `As told by the trace until ${seconds(t)}. A recording holds no states, timers and inboxes.`
      : `${seen.events} events, result: ${seen.result}, at ${seconds(t)}`)];
    for (const crash of seen.crashes ?? []) parts.push(element('p', `crashed: ${crash}`));
    for (const machine of seen.machines) parts.push(seen.told ? this.told(machine) : this.machine(machine));
    if (seen.told) parts.push(this.packets(seen.packets), this.tubes(id, t));
    const last = this.details('last events', `last events (${seen.last.length})`);
    last.append(element('pre', seen.last.map(([at, name, event]) => `${seconds(at)} ${name} ${event}`).join('\n')));
    parts.push(last);
    settle($('machines'), parts);
  }
  // What a machine has told last.
  told({ name, module, state, at }) {
    const details = this.details(name, `${name}: ${brief(state)}`);
    details.append(element('p', `${module ? `${module}, ` : ''}told at ${seconds(at)}`), element('pre', state));
    return details;
  }
  packets(packets) {
    const details = this.details('packets', `last packets (${packets.length})`), list = element('ul', '');
    list.append(...packets.map(packet => element('li', words(packet))));
    details.append(list);
    return details;
  }
  tubes(id, t) {
    const robot = this.team.robots.get(id), tubes = robot ? robot.tubes(t) : [];
    const details = this.details('tubes', `tubes that it holds (${tubes.length})`);
    details.append(element('pre', tubes.map(tube => tube.map(mm => (mm / 1000).toFixed(2)))
      .map(([x1, y1, x2, y2]) => `${x1}, ${y1} → ${x2}, ${y2} m`).join('\n')));
    return details;
  }
  machine({ name, module, state, data, timers }) {
    const short = brief(state);
    const details = this.details(name, `${name}: ${short}`);
    if (module) details.append(element('p', module));
    if (timers) details.append(this.timers(timers));
    details.append(element('pre', short === String(state) ? data ?? '' : `${state}\n${data ?? ''}`));
    return details;
  }
  timers(timers) {
    const list = element('ul', '', { className: 'timers' });
    list.append(...timers.map(([name, due]) => element('li',
      `timer ${name}${typeof due === 'number' ? `, due at ${seconds(due)}` : ''}`)));
    return list;
  }
  details(name, summary) {
    const details = element('details', '', { open: this.opened.has(name) });
    details.dataset.key = name;
    details.append(element('summary', summary));
    return details;
  }

  // -- what changes with time

  refresh(t) {
    this.where(t);
    this.lights(t);
    this.faults(t);
    if ($('team').open) this.table(t);
    const { state, team } = this;
    const moment = team.clock.paused ? state.ticks + 0.5 : Math.floor(performance.now() / 1000);
    if (state.selected !== null && state.live && this.asked !== moment && team.run.kind === 'simulation') {
      this.asked = moment;
      this.send({ do: 'look', robot: state.selected });
    }
    if (state.selected !== null && team.run.kind === 'recording' && state.playing === undefined &&
        this.asked !== t + 0.5) {
      this.asked = t + 0.5;
      this.send({ do: 'look', robot: state.selected, at: t });
    }
  }
  where(t) {
    const robot = this.team.robots.get(this.state.selected), pose = robot && robot.pose(t);
    $('robot-where').textContent = pose ? describe(robot, pose, t) + this.off(pose) : 'click a robot, or give its number';
  }
  lights(t) {
    const broken = this.team.violations.filter(v => v.t <= t), blind = this.team.unjudged.filter(u => u.t <= t);
    const key = `${broken.length} ${blind.length} ${this.team.run.contracts}`;
    if (this.shown.lights === key) return;
    this.shown.lights = key;
    const known = this.team.run.contracts, others = broken.map(v => v.contract).filter(c => !known.includes(c));
    settle($('lights'), known.concat([...new Set(others)]).map(name => {
      const own = broken.filter(v => v.contract === name), light = element('span', '');
      light.dataset.key = name;
      // What only robots have recorded nobody has judged.
      const since = blind.find(u => u.contracts.length === 0 || u.contracts.includes(name));
      const unknown = this.team.run.judged === false || since;
      if (unknown) light.className = 'unknown';
      if (since) light.title = since.text;
      light.append(element('i', ''), own.length ? '' : `${name} ${!unknown ? 'kept' : 'not judged'}` +
        `${since ? ` from ${seconds(since.t)} on` : ''}`);
      if (own.length) {
        light.className = 'broken';
        light.append(element('button', `${name} broken at ${seconds(own[0].t)}`,
          { title: own[0].text, onclick: () => window.starl.scrub(own[0].t) }));
      }
      return light;
    }));
    this.violations(broken, blind);
  }
  // What is broken in words, for all eyes: the first of each contract; and what is not judged, and why.
  violations(broken, blind) {
    const first = broken.filter((v, i) => broken.findIndex(w => w.contract === v.contract) === i);
    $('broken').classList.toggle('absent', first.length + blind.length === 0);
    settle($('broken'), first.map(v => element('li', v.text)).concat(
      blind.map(u => element('li', u.text, { className: 'unjudged' }))));
  }
  faults(t) {
    const all = [...this.team.faults.values()];
    const key = all.map(f => `${f.id} ${f.from} ${f.to} ${f.from <= t} ${f.to <= t}`).join();
    if (this.shown.faults === key) return;
    this.shown.faults = key;
    settle($('faults'), all.map(fault => {
      const over = fault.to <= t && fault.to > fault.from;
      const item = element('li', `${fault.id}: ${fault.kind.replaceAll('_', ' ')} ${fault.target} ` +
        `from ${seconds(fault.from)}${fault.to > fault.from ? ` to ${fault.to > 9e11 ? '…' : seconds(fault.to)}` : ''} `);
      item.dataset.key = fault.id;
      item.className = over || fault.from > t ? 'over' : '';
      if (!over && fault.from <= t && fault.to > fault.from && this.team.run.kind !== 'recording')
        item.append(element('button', 'heal', { onclick: () => this.hand({ do: 'heal', id: fault.id }, 'fault') }));
      return item;
    }));
  }
  table(t) {
    const now = Math.floor(performance.now() / 500);
    if (this.shown.table === now) return;
    this.shown.table = now;
    const robots = [...this.team.robots.values()], part = robots.slice(this.firstRow, this.firstRow + MOST_ROWS);
    $('rows').classList.toggle('absent', robots.length <= MOST_ROWS);
    $('rows-said').textContent = `${this.firstRow + 1} to ${this.firstRow + part.length} of ${robots.length} robots`;
    $('rows-back').disabled = this.firstRow === 0;
    $('rows-on').disabled = this.firstRow + MOST_ROWS >= robots.length;
    settle($('robots'), part.map(robot => {
      const row = element('tr', ''), pose = robot.pose(t) || [NaN, NaN, NaN], name = element('td', '');
      name.append(element('button', robot.id, { onclick: () => this.select(robot.id) }));
      row.dataset.key = robot.id;
      row.append(name, element('td', (pose[0] / 1000).toFixed(3)), element('td', (pose[1] / 1000).toFixed(3)),
        element('td', degrees(pose[2])), element('td', robot.condition(t) + this.off(pose)));
      return row;
    }));
  }
  // Another part of the robots.
  rows(by) {
    const next = this.firstRow + by;
    if (next >= 0 && next < this.team.robots.size) this.firstRow = next;
    this.shown.table = null;
    this.table(this.floor.t);
  }
  off([x, y]) { return this.floor.isOutside(x, y) ? ', off the floor' : ''; }
}

const degrees = radians => `${Math.round(((radians * 180 / Math.PI) % 360 + 360) % 360)}°`;

function describe(robot, [x, y, heading], t) {
  const tubes = robot.tubes(t).length;
  return `${robot.condition(t)} at ${(x / 1000).toFixed(3)}, ${(y / 1000).toFixed(3)} m, ${degrees(heading)}` +
    `${robot.isDown(t) ? ', pen down' : ''}${tubes ? `, holds a tube` : ''}`;
}

// What the user typed, for the shape of a kind's target.
function target(text, shape) {
  const parts = text.trim().split(/[ ,;]+/).filter(part => part);
  const value = part => /^\d+$/.test(part) ? Number(part) : part;
  const values = parts.map(value);
  return shape === 'group' ? values : values.length === 1 ? values[0] : values;
}
