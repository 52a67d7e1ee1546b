// A panel of the project, in a frame without an origin: it sees what it is sent and says what it wants. One that
// throws, falls silent or floods is taken out; browsers give such a frame a process of its own.

import type { Frame, Look, PanelScene } from './panel';
import type { Series } from './net';

/** Looks at the panel, ms, and how many of them it may be silent. */
const BEAT = 500;
const PATIENCE = 8;
/** Messages between two beats, and series asked for at once. */
const MESSAGES_MAX = 1500;
const ASKED_MAX = 8;
const SETTINGS_MAX = 1 << 16;
const PATHS_MAX = 64;

export type Wishes = {
  keep(settings: Record<string, unknown>): void;
  watch(paths: string[]): void;
  series(paths: string[], from: number, to: number, points: number): Promise<Series>;
  seek(time: number): void;
  key(key: KeyboardEventInit): void;
  began(title: string | null): void;
  resized(): void;
  failed(problem: string): void;
};

const isPaths = (value: unknown): value is string[] => Array.isArray(value) && value.length <= PATHS_MAX && value.every(path => typeof path === 'string' && path.length < 300);

export class Sandbox {
  private readonly frame = document.createElement('iframe');
  private port: MessagePort | null = null;
  private readonly beat: ReturnType<typeof setInterval>;
  private next: Frame | null = null;
  private isDrawing = false;
  private hasBegun = false;
  /** Beats since an answer was due, and messages since the last beat. */
  private silent = 0;
  private messages = 0;
  private isDue = true;
  private asked = 0;
  private sought: number | null = null;
  private settings: Record<string, unknown> | null = null;
  private isOver = false;
  /** Whether the frame is one of ours, and which address was tried. */
  private isThere = false;
  private isPlain = false;
  private hasLoaded = false;

  constructor(root: HTMLElement, name: string, private readonly begin: { source: string; scene: PanelScene; look: Look; settings: Record<string, unknown> }, private readonly wishes: Wishes) {
    this.frame.title = name;
    this.frame.setAttribute('sandbox', 'allow-scripts');
    // A name of its own, which leads to this machine: browsers give each site a process, so that a panel that
    // hangs holds up no other. Where such names are not known, the page's own has to do.
    const own = new URL('/frame', location.href);
    own.hostname = `p${Array.from(crypto.getRandomValues(new Uint8Array(8)), byte => byte.toString(16).padStart(2, '0')).join('')}.localhost`;
    this.load(own.href);
    root.append(this.frame);
    this.beat = setInterval(() => this.look(), BEAT);
  }

  private load(address: string): void {
    const channel = new MessageChannel();
    this.hasLoaded = false;
    this.port?.close();
    this.port = channel.port1;
    this.port.onmessage = event => this.hear(event.data);
    this.silent = 0;
    this.frame.onload = () => {
      // A frame that leads itself elsewhere is none of ours.
      if (this.hasLoaded) { if (this.isThere) this.fail('it left its frame'); return; }
      this.hasLoaded = true;
      this.silent = 0;
      this.frame.contentWindow?.postMessage(null, '*', [channel.port2]);
    };
    this.frame.src = address;
  }

  /** Draws, when the last picture is done; only the newest of those that wait is drawn. */
  draw(frame: Frame): void {
    this.next = frame;
    this.flush();
  }

  restyle(look: Look): void { this.port?.postMessage({ look }); }

  close(): void {
    this.flushSettings();
    this.isOver = true;
    clearInterval(this.beat);
    this.port?.close();
    this.frame.remove();
  }

  /** Settings are written once a beat. */
  private flushSettings(): void {
    if (this.settings) this.wishes.keep(this.settings);
    this.settings = null;
  }

  private fail(problem: string): void {
    if (this.isOver) return;
    this.close();
    this.wishes.failed(problem);
  }

  private flush(): void {
    if (!this.hasBegun || this.isDrawing || !this.next || this.isOver) return;
    this.port?.postMessage({ frame: this.next });
    this.next = null;
    this.isDrawing = this.isDue = true;
    this.silent = 0;
  }

  private look(): void {
    this.messages = 0;
    this.flushSettings();
    // Beats of a page that sleeps are few, hence they are counted, not timed.
    if (this.isDue) this.silent++;
    // A frame that loads slowly is waited for; one that loaded and is not ours came from a name that is not known.
    const patience = this.hasLoaded ? PATIENCE : 2 * PATIENCE;
    if (!this.isThere && !this.isPlain && this.silent > (this.hasLoaded ? patience / 2 : patience)) {
      this.isPlain = true;
      this.load(new URL('/frame', location.href).href);
    } else if (this.silent > patience) {
      this.fail(`it has not answered for ${patience * BEAT / 1000} s`);
      return;
    }
    if (!this.isDue) { this.isDue = true; this.silent = 0; this.port?.postMessage({ ping: true }); }
  }

  private hear(said: Record<string, unknown>): void {
    if (this.isOver) return;
    this.messages++;
    if (this.messages > MESSAGES_MAX) { this.fail(`it floods the page: more than ${MESSAGES_MAX} messages in ${BEAT / 1000} s`); return; }
    if (said.there) { this.isThere = true; this.silent = 0; this.port?.postMessage({ begin: this.begin }); }
    else if (said.began) { this.hasBegun = true; this.isDue = false; this.wishes.began(typeof said.title === 'string' ? said.title.slice(0, 60) : null); this.flush(); }
    else if (said.drawn) { this.isDrawing = this.isDue = false; this.flush(); }
    else if (said.pong) this.isDue = this.isDrawing;
    else if (said.resized) this.wishes.resized();
    else if (typeof said.failed === 'string') this.fail([said.failed, said.stack].filter(Boolean).join('\n').slice(0, 600));
    else if (said.keep) {
      if (JSON.stringify(said.keep).length > SETTINGS_MAX) this.fail('its settings are longer than 64 KiB');
      else this.settings = said.keep as Record<string, unknown>;
    } else if (said.watch) {
      if (isPaths(said.watch)) this.wishes.watch(said.watch);
      else this.fail(`watch: must be at most ${PATHS_MAX} paths of signals`);
    } else if (typeof said.series === 'number') {
      const { series, paths, from, to, points } = said;
      const isWell = isPaths(paths) && [from, to, points].every(Number.isFinite) && Number(points) >= 1 && Number(points) <= 8192;
      if (this.asked >= ASKED_MAX) { this.fail(`series: more than ${ASKED_MAX} were asked for at once`); return; }
      if (!isWell) { this.fail(`series: must be at most ${PATHS_MAX} paths, two finite times and 1 to 8192 points`); return; }
      this.asked++;
      void this.wishes.series(paths, Number(from), Number(to), Math.round(Number(points))).then(found => { this.asked--; if (!this.isOver) this.port?.postMessage({ answer: series, ...found }); });
    } else if (typeof said.seek === 'number' && Number.isFinite(said.seek)) {
      // Of many the newest, once a picture.
      if (this.sought === null) requestAnimationFrame(() => { const t = this.sought; this.sought = null; if (t !== null && !this.isOver) this.wishes.seek(t); });
      this.sought = said.seek;
    } else if (said.key) this.wishes.key(said.key as KeyboardEventInit);
  }
}
