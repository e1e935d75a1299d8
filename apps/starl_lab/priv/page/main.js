// The page: what the server tells goes into the team (model.js), what the user does goes to the server.
import { Team } from './model.js';
import { Floor } from './draw.js';
import { chart, words } from './chart.js';
import { curves } from './curves.js';
import { marks } from './timeline.js';
import { connect } from './link.js';
import { Panel } from './panel.js';
import { settle } from './settle.js';
import { seconds } from './time.js';

// What moves less than this many pixels is a click.
const CLICK_PX = 6;
// The messages that are listed as text.
const MOST_TALK = 100;
// Of the line to the server.
const SAYS = { open: '',
  closed: 'the server has ended, or cannot be reached; what was told can still be looked at',
  refused: 'the server does not let this page in: open the whole address that it has printed, ' +
    'with the token behind #' };

const $ = id => document.getElementById(id);
const team = new Team();
const floor = new Floor($('map'), team);
const state = { selected: null, shown: 0, live: true, column: 0, told: { now: 0, before: 0, at: 0, wait: 30 },
  frames: 0, fps: 0, open: false, ticks: 0 };

const send = connect(rows => {
  for (const row of rows) {
    const kind = team.take(row);
    if (kind === 't' && !team.part) ticked(row[1]);
    else if (kind === 'w') state.asked = 0;
    else if (kind === 'run') began();
    else if (kind === 'reset') { state.live = !isRecording(); floor.inked.key = ''; }
    else if (kind === 'gap' && !isRecording()) panel.say('earlier moments are not kept');
    else if (kind === 'look') panel.look(row[1], row[2], window.starl.seen = row[3]);
    else if (kind === 'yes' || kind === 'no') panel.say(row[1], row[2], kind === 'no');
  }
}, how => {
  state.open = how === 'open';
  panel.say(SAYS[how], '', true, true);
  if (state.open) team.clear();
});
const panel = new Panel(team, floor, state, send, select);

let floorOf = '';
function began() {
  const { run } = team, world = run.world.join();
  document.title = `StarL: ${run.app}`;
  $('title').textContent = String(run.app).replace(/^starl_/, '');
  $('facts').textContent = `${run.robots.length} robots, seed ${run.seed}, floor ` +
    `${run.world[0] / 1000} × ${run.world[1] / 1000} m` + (run.range ? `, range ${run.range / 1000} m` : '');
  const shown = { simulation: ['pause', 'speed-label', 'step', 'until', 'save', 'fault'],
    live: ['fault'], recording: ['pause', 'speed-label'] }[run.kind];
  for (const id of ['pause', 'speed-label', 'step', 'until', 'save', 'fault'])
    $(id).classList.toggle('absent', !shown.includes(id));
  $('heal-all').classList.toggle('absent', run.kind === 'recording');
  $('live').textContent = run.kind === 'recording' ? 'End' : 'Live';
  $('selected').max = run.robots.length;
  // the same run may be told again, to a page that has missed a part of it
  if (world !== floorOf) floor.view = null;
  floorOf = world;
  panel.began();
}

function ticked(now) {
  const wall = performance.now(), { told } = state;
  if (now > told.now) {
    told.wait = Math.min(200, Math.max(8, wall - told.at));
    told.before = Math.max(told.now, now - 2e6);
  } else told.before = now;
  [told.now, told.at] = [now, wall];
  state.ticks++;
}

// The present glides from one tick to the next.
function present(wall) {
  const { told } = state, part = Math.min(1, (wall - told.at) / told.wait);
  return team.clock.paused ? told.now : told.before + (told.now - told.before) * part;
}

function select(id) {
  state.selected = team.run && team.run.robots.includes(id) ? id : null;
  $('selected').value = state.selected ?? '';
  panel.selected();
}

// -- time ------------------------------------------------------------------------------------

const isRecording = () => Boolean(team.run) && team.run.kind === 'recording';
const isPaused = () => isRecording() ? state.playing === undefined
  : team.clock.paused;

function toggle() {
  if (isRecording()) {
    state.playing = state.playing === undefined ? performance.now() : undefined;
    state.live = false;
    if (state.shown >= team.until) scrub(team.from, true);
  } else {
    send(team.clock.paused ? { do: 'go' } : { do: 'pause' });
    if (team.clock.paused) state.live = true;
  }
}

function scrub(us, playing = false) {
  state.live = false;
  if (!playing) state.playing = undefined;
  state.shown = Math.max(team.from, Math.min(us, team.until));
  want(state.shown);
}

// A part of a long recording that the page does not have. What is asked while much is on its way gets
// no answer, so it is asked again.
function want(us) {
  if (!isRecording() || has(us)) return;
  if (state.asked && state.wanted === us && performance.now() - state.asked < 5000) return;
  [state.asked, state.wanted] = [performance.now(), us];
  send({ do: 'moment', at: us });
}

$('pause').onclick = toggle;
$('step').onclick = () => { state.live = true; send({ do: 'step', ...(state.selected ? { robot: state.selected } : {}) }); };
$('live').onclick = () => { if (isRecording()) scrub(team.until); else state.live = true; };
$('speed').onchange = event => {
  const { value } = event.target;
  state.pace = value === 'max' ? 100 : Number(value);
  if (team.run.kind === 'simulation') send({ do: 'speed', speed: value === 'max' ? 'max' : Number(value) });
};
$('until').onsubmit = event => {
  event.preventDefault();
  state.live = true;
  panel.say('', 'until');
  send({ do: 'until', at: Number($('at').value), of: 'until' });
};
$('time').oninput = event => scrub(Number(event.target.value));

// -- the floor -------------------------------------------------------------------------------

// One finger or the mouse moves the floor, two fingers move and zoom it. What hardly moves is a click.
const fingers = new Map();    // by the pointer's id: { x, y }
let moved = 0;
const middle = () => {
  const all = [...fingers.values()], [a, b] = [all[0], all[1] ?? all[0]];
  return { x: (a.x + b.x) / 2, y: (a.y + b.y) / 2, apart: Math.hypot(a.x - b.x, a.y - b.y) };
};
const lifted = event => fingers.delete(event.pointerId);
$('map').onpointerdown = event => {
  if (event.button !== 0 || fingers.size === 2) return;
  if (fingers.size === 0) moved = 0;
  $('map').setPointerCapture(event.pointerId);
  fingers.set(event.pointerId, { x: event.offsetX, y: event.offsetY });
};
$('map').onpointermove = event => {
  if (!fingers.has(event.pointerId)) return;
  const before = middle();
  fingers.set(event.pointerId, { x: event.offsetX, y: event.offsetY });
  const now = middle();
  moved += Math.abs(now.x - before.x) + Math.abs(now.y - before.y) + Math.abs(now.apart - before.apart);
  if (moved < CLICK_PX) return;
  floor.move(now.x - before.x, now.y - before.y);
  if (before.apart > 0 && now.apart > 0) floor.zoom(now.apart / before.apart, now.x, now.y);
};
$('map').onpointerup = event => {
  if (fingers.size === 1 && lifted(event) && moved < CLICK_PX)
    select(floor.robotAt(event.offsetX, event.offsetY, state.shown));
  lifted(event);
};
$('map').onpointercancel = $('map').onlostpointercapture = lifted;
// By how far the wheel was turned: a notch is 100 to 120 pixels, two fingers on a pad send many small parts of
// one. A pinch on a pad comes as a wheel with Ctrl, and in smaller parts still.
$('map').onwheel = event => {
  event.preventDefault();
  const pixels = event.deltaY * (event.deltaMode === 0 ? 1 : event.deltaMode === 1 ? 20 : 400);
  const turned = Math.max(-400, Math.min(400, pixels * (event.ctrlKey ? 5 : 1)));
  floor.zoom(2 ** (-turned / 400), event.offsetX, event.offsetY);
};
const zoomed = { in: () => floor.zoom(1.25), out: () => floor.zoom(0.8), all: () => floor.fit() };
for (const [how, zoom] of Object.entries(zoomed)) $(`zoom-${how}`).onclick = zoom;
const onMap = { ArrowLeft: () => floor.move(40, 0), ArrowRight: () => floor.move(-40, 0),
  ArrowUp: () => floor.move(0, 40), ArrowDown: () => floor.move(0, -40) };
$('map').onkeydown = event => {
  if (onMap[event.key]) { onMap[event.key](); event.preventDefault(); }
};
const next = by => {
  const ids = team.run.robots, i = ids.indexOf(state.selected);
  select(ids[(i + by + ids.length) % ids.length]);
};
const i0 = () => state.selected === null ? 0 : -1;
const keys = { ' ': toggle, s: () => $('step').click(), n: () => next(1), b: () => next(i0()),
  l: () => $('live').onclick(), ',': () => scrub(state.shown - 1e6), '.': () => scrub(state.shown + 1e6),
  '+': zoomed.in, '-': zoomed.out, 0: zoomed.all };
// A field takes what is typed, Esc leaves it; space is the button's that the keyboard has reached.
const typed = field => /^(SELECT|TEXTAREA)$/.test(field.tagName) ||
  field.tagName === 'INPUT' && !/^(checkbox|range)$/.test(field.type);
const pressed = (field, key) => key === ' ' && (/^(BUTTON|SUMMARY)$/.test(field.tagName) || field.type === 'checkbox');
document.onkeydown = event => {
  const { target, key } = event;
  if (key === 'Escape') target.blur();
  if (typed(target) || pressed(target, key) || event.ctrlKey || event.metaKey || event.altKey ||
      !keys[key] || !team.run) return;
  keys[key]();
  event.preventDefault();
};
// A button that was clicked with the mouse or a finger does not keep the keys: space would press it again.
document.addEventListener('click', event => {
  const button = event.target.closest?.('button, summary, input[type=checkbox]');
  if (button && event.detail > 0) button.blur();
});
$('selected').onchange = event => select(Number(event.target.value));
for (const name of Object.keys(floor.show)) {
  $(`show-${name}`).onchange = event => { floor.show[name] = event.target.checked; floor.inked.key = ''; };
}

// -- frames ----------------------------------------------------------------------------------

const has = us => us >= team.begin && us <= team.now;
let counted = { frames: 0, at: performance.now() }, slow = 0;

function frame(wall) {
  if (team.run) {
    if (state.playing !== undefined) {
      if (has(state.shown))
        state.shown = Math.min(team.now, state.shown + (wall - state.playing) * 1000 * (state.pace || 1));
      state.playing = state.shown >= team.until ? undefined : wall;
      // the next part
      if (state.playing !== undefined && state.shown === team.now) want(team.now + 1);
    } else if (state.live) state.shown = present(wall);
    floor.draw(state.shown, state.selected);
    if (wall - slow > 120) { slow = wall; rarely(); }
  }
  state.frames++;
  if (wall - counted.at >= 1000) {
    state.fps = Math.round((state.frames - counted.frames) * 1000 / (wall - counted.at));
    counted = { frames: state.frames, at: wall };
  }
  requestAnimationFrame(frame);
}

function offFloor(t) {
  const off = team.poses(t).filter(([, x, y]) => floor.isOutside(x, y)).map(([id]) => id);
  const named = off.slice(0, 5).join(', ') + (off.length > 5 ? ` and ${off.length - 5} more` : '');
  return off.length ? ` · off the floor: ${named}` : '';
}

let talked = '';
function rarely() {
  const { clock } = team, t = state.shown, paused = isPaused();
  $('clock').textContent = seconds(t);
  $('pause').textContent = clock.ending ? 'Over' : paused ? 'Go on' : 'Pause';
  $('pause').disabled = Boolean(clock.ending) && team.run.kind !== 'recording';
  if (team.run.kind === 'recording') $('pause').textContent = paused ? 'Play' : 'Pause';
  $('pause').setAttribute('aria-pressed', String(Boolean(paused)));
  if (document.activeElement !== $('speed') && clock.speed && team.run.kind === 'simulation') {
    const speed = String(clock.speed), known = [...$('speed').options].some(({ value }) => value === speed);
    if (!known) $('speed').append(new Option(`${speed} ×`, speed));
    $('speed').value = speed;
  }
  $('live').disabled = state.live || isRecording() && state.shown >= team.until;
  const slider = $('time');
  slider.min = team.from;
  slider.max = Math.max(team.until, 1);
  slider.value = t;
  slider.setAttribute('aria-valuetext', seconds(t));
  $('figures').textContent = (state.live || team.run.kind === 'recording' ? '' : 'in the past · ') +
    (isRecording() && !has(state.shown) ? 'reading …' : isRecording() && state.shown < team.until ? 'recording' :
      clock.ending ? `over: ${clock.ending}` : clock.paused ? 'paused' : `${clock.real ?? ''} × real time`) +
    ` · ${state.fps} frames/s` + (team.leftOut ? ` · ${team.leftOut} packets not shown` : '') + offFloor(t);
  marks($('marks'), floor, team, team.from, Math.max(team.until, 1));
  if (isRecording() && state.asked) want(state.shown);
  const { talk, ids, all } = chart($('chart'), floor, team, t, state.selected, state.column);
  columns(ids, all);
  measures(t);
  const list = $('talk'), key = talk.length + ' ' + t;
  $('talk-said').textContent = talk.length > MOST_TALK ? ` (the last ${MOST_TALK} of ${talk.length})` : '';
  if (list.parentElement.open && key !== talked) {
    talked = key;
    settle(list, talk.slice(-MOST_TALK).map(p => item(words(p))));
  }
  panel.refresh(t);
}

// What applications measure; the choice stays while names come.
function measures(t) {
  const names = team.measured, choice = $('measure');
  $('measures').classList.toggle('absent', names.length === 0);
  if (names.length === 0) return;
  if (names.join() !== [...choice.options].map(option => option.value).join()) {
    const chosen = choice.value;
    choice.replaceChildren(...names.map(name => new Option(name, name)));
    if (names.includes(chosen)) choice.value = chosen;
  }
  $('measured').textContent = curves($('curves'), floor, team, choice.value, t, state.selected);
}

// The robots that talk, of which the chart has room for some.
function columns(ids, all) {
  const others = all.filter(id => id !== state.selected), shown = ids.filter(id => id !== state.selected);
  const first = others.indexOf(shown[0]), last = others.indexOf(shown.at(-1)), room = shown.length;
  $('columns').classList.toggle('absent', ids.length === all.length);
  $('columns-said').textContent = `${ids.length} of ${all.length} robots`;
  $('columns-back').disabled = first <= 0;
  $('columns-on').disabled = last === others.length - 1;
  const from = i => () => { state.column = others[i]; rarely(); };
  $('columns-back').onclick = from(Math.max(0, first - room));
  $('columns-on').onclick = from(last + 1);
}

function item(text) {
  const li = document.createElement('li');
  li.textContent = text;
  return li;
}

requestAnimationFrame(frame);

// For tests, and for the curious: what the page shows now.
window.starl = {
  team, state, floor, send, select, scrub,
  poses: () => Object.fromEntries(team.poses(state.shown).map(([id, ...pose]) => [id, pose])),
  live: () => { state.live = true; },
};
