// The page: what the server tells goes into the team (model.js), what the user does goes to the server.
import { Team } from './model.js';
import { Floor } from './draw.js';
import { chart, words } from './chart.js';
import { marks } from './timeline.js';
import { connect } from './link.js';
import { Panel } from './panel.js';
import { seconds } from './time.js';

const $ = id => document.getElementById(id);
const team = new Team();
const floor = new Floor($('map'), team);
const state = { selected: null, shown: 0, live: true, told: { now: 0, before: 0, at: 0, wait: 30 },
  frames: 0, fps: 0, open: false, ticks: 0 };

const send = connect(rows => {
  for (const row of rows) {
    const kind = team.take(row);
    if (kind === 't' && !team.part) ticked(row[1]);
    else if (kind === 'w') state.asked = 0;
    else if (kind === 'run') began();
    else if (kind === 'reset') { state.live = !isRecording(); floor.inked.key = ''; }
    else if (kind === 'gap' && !isRecording()) news('earlier moments are not kept', false);
    else if (kind === 'look') panel.look(row[1], row[2], window.starl.seen = row[3]);
    else if (kind === 'yes' || kind === 'no') news(row[1], kind === 'no');
  }
}, how => {
  state.open = how === 'open';
  if (state.open) team.clear();
  else news('the server has ended, or cannot be reached; what was told can still be looked at', true);
});
const panel = new Panel(team, floor, state, send, select);

function news(text, bad) {
  $('news').textContent = text;
  $('news').classList.toggle('bad', bad);
}

function began() {
  const { run } = team;
  document.title = `StarL: ${run.app}`;
  $('title').textContent = String(run.app).replace(/^starl_/, '');
  $('facts').textContent = `${run.robots.length} robots, seed ${run.seed}, floor ` +
    `${run.world[0] / 1000} × ${run.world[1] / 1000} m` + (run.range ? `, range ${run.range / 1000} m` : '');
  const shown = { simulation: ['pause', 'speed-label', 'step', 'until', 'save', 'fault'],
    live: [], recording: ['pause', 'speed-label'] }[run.kind];
  for (const id of ['pause', 'speed-label', 'step', 'until', 'save', 'fault'])
    $(id).classList.toggle('absent', !shown.includes(id));
  $('heal-all').classList.toggle('absent', run.kind === 'recording');
  $('live').textContent = run.kind === 'recording' ? 'End' : 'Live';
  $('selected').max = run.robots.length;
  floor.view = null;
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
  send({ do: 'until', at: Number($('at').value) });
};
$('time').oninput = event => scrub(Number(event.target.value));

// -- the floor -------------------------------------------------------------------------------

let drag = null;
$('map').onpointerdown = event => { drag = { x: event.offsetX, y: event.offsetY, moved: 0 }; };
$('map').onpointermove = event => {
  if (!drag || event.buttons === 0) return;
  floor.move(event.offsetX - drag.x, event.offsetY - drag.y);
  drag = { x: event.offsetX, y: event.offsetY,
    moved: drag.moved + Math.abs(event.movementX) + Math.abs(event.movementY) };
};
$('map').onpointerup = event => {
  if (drag && drag.moved < 6) select(floor.robotAt(event.offsetX, event.offsetY, state.shown));
  drag = null;
};
$('map').onwheel = event => {
  event.preventDefault();
  floor.zoom(event.deltaY < 0 ? 1.2 : 1 / 1.2, event.offsetX, event.offsetY);
};
const onMap = { '+': () => floor.zoom(1.25), '-': () => floor.zoom(0.8), '0': () => floor.fit(),
  ArrowLeft: () => floor.move(40, 0), ArrowRight: () => floor.move(-40, 0),
  ArrowUp: () => floor.move(0, 40), ArrowDown: () => floor.move(0, -40) };
$('map').onkeydown = event => {
  if (onMap[event.key]) { onMap[event.key](); event.preventDefault(); }
};
const next = by => {
  const ids = team.run.robots, i = ids.indexOf(state.selected);
  select(ids[(i + by + ids.length) % ids.length]);
};
const keys = { ' ': toggle, s: () => $('step').click(), n: () => next(1), b: () => next(i0()),
  l: () => $('live').onclick(), ',': () => scrub(state.shown - 1e6), '.': () => scrub(state.shown + 1e6) };
const i0 = () => state.selected === null ? 0 : -1;
document.onkeydown = event => {
  const own = /^(INPUT|SELECT|TEXTAREA|BUTTON|SUMMARY)$/.test(event.target.tagName);
  if (own || event.ctrlKey || event.metaKey || event.altKey || !keys[event.key] || !team.run) return;
  keys[event.key]();
  event.preventDefault();
};
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

let talked = '';
function rarely() {
  const { clock } = team, t = state.shown, paused = isPaused();
  $('clock').textContent = seconds(t);
  $('pause').textContent = clock.ending ? 'Over' : paused ? 'Go on' : 'Pause';
  $('pause').disabled = Boolean(clock.ending) && team.run.kind !== 'recording';
  if (team.run.kind === 'recording') $('pause').textContent = paused ? 'Play' : 'Pause';
  $('pause').setAttribute('aria-pressed', String(Boolean(paused)));
  if (document.activeElement !== $('speed') && clock.speed && team.run.kind === 'simulation') {
    $('speed').value = String(clock.speed);
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
    ` · ${state.fps} frames/s` + (team.leftOut ? ` · ${team.leftOut} packets not shown` : '');
  marks($('marks'), floor, team, team.from, Math.max(team.until, 1));
  if (isRecording() && state.asked) want(state.shown);
  const talk = chart($('chart'), floor, team, t, state.selected);
  const list = $('talk'), key = talk.length + ' ' + t;
  if (list.parentElement.open && key !== talked) {
    talked = key;
    list.replaceChildren(...talk.slice(-30).map(p => item(words(p))));
  }
  panel.refresh(t);
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
