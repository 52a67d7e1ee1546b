// Plays a crossing in its page.

import { drawCrossing } from './crossing.js';

const data = JSON.parse(/** @type {HTMLElement} */ (document.getElementById('data')).textContent || '{}');
const scene = /** @type {HTMLElement} */ (document.getElementById('scene'));
const play = /** @type {HTMLButtonElement} */ (document.getElementById('play'));
const time = /** @type {HTMLInputElement} */ (document.getElementById('time'));
const words = /** @type {HTMLElement} */ (document.getElementById('words'));
const end = data.frames[data.frames.length - 1].t;
/** Seconds of the crossing in a second of the player. */
const PACE = 4;
let now = 0;
let playing = false;
let before = 0;

/** The last frame that is not after `t`. @param {number} t */
function frameAt(t) {
  let low = 0;
  let high = data.frames.length - 1;
  while (low < high) {
    const middle = Math.ceil((low + high) / 2);
    if (data.frames[middle].t <= t) low = middle; else high = middle - 1;
  }
  return low;
}

function show() {
  const k = frameAt(now);
  const picture = drawCrossing(data, k);
  scene.innerHTML = picture.svg;
  words.textContent = `${now.toFixed(1)} s · ${data.frames[k].deed} · ${picture.words}`;
  time.value = String(now);
  play.textContent = playing ? 'Pause' : 'Play';
}

/** @param {number} stamp ms */
function tick(stamp) {
  if (!playing) return;
  now = Math.min(end, now + PACE * (stamp - before) / 1000);
  before = stamp;
  if (now >= end) playing = false;
  show();
  requestAnimationFrame(tick);
}

function toggle() {
  playing = !playing;
  if (playing && now >= end) now = 0;
  before = performance.now();
  show();
  requestAnimationFrame(tick);
}

play.addEventListener('click', toggle);
time.addEventListener('input', () => { playing = false; now = Number(time.value); show(); });
document.addEventListener('keydown', event => {
  if (event.key !== ' ' || event.target === play) return;
  event.preventDefault();
  toggle();
});
show();
