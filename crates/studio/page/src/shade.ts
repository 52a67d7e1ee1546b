// What colors a trail: the speed, the time, or any signal of the robot, on a scale that follows the run.

import { clamp, roundUp, viridis } from '../../../sim/web/draw.js';
import type { Tracks } from '../../../sim/web/run.js';
import type { Line, Link, Series } from './net';

export const SPEED = 'speed';
export const TIME = 'time';
/** Points of a signal that the page does not have row by row. */
const POINTS = 4000;

const VERMILION = [0xd5, 0x5e, 0x00], WHITE = [0xf4, 0xf4, 0xf4], BLUE = [0x00, 0x72, 0xb2];

/** Blue, white, vermilion of `u` in [0, 1]: for what has two signs. */
function signedColor(u: number): string {
  const at = clamp(u, 0, 1) * 2 - 1;
  const end = at < 0 ? BLUE : VERMILION;
  return `rgb(${WHITE.map((w, k) => Math.round(w + (end[k] - w) * Math.abs(at))).join()})`;
}

export class Shade {
  low = 0;
  high = 1;
  /** Whether values have come since the last look at the scale. */
  isNew = false;
  private isSigned = false;
  private series: Series | null = null;
  private isAsking = false;
  private rows = -1;

  constructor(private readonly link: Link, private readonly line: Line, private readonly path: string) {}

  readonly color = (u: number): string => this.isSigned ? signedColor(u) : viridis(u);

  gradient(): string {
    return `linear-gradient(90deg,${[0, 0.2, 0.4, 0.6, 0.8, 1].map(this.color).join()})`;
  }

  private values(): ArrayLike<number> | null {
    return this.path === SPEED || this.path === TIME ? null : this.line.run.signals[this.path]?.values as number[] ?? this.series?.columns[0] ?? null;
  }

  /** Looks at the extremes; whether the scale is another now. */
  scale(): boolean {
    const { low, high, isSigned } = this;
    this.isNew = false;
    if (this.path === SPEED) this.high = this.line.speedLimit;
    else if (this.path === TIME) this.high = roundUp(this.line.end || 1);
    else {
      this.ask();
      const values = this.values();
      let [least, most] = [Infinity, -Infinity];
      for (let k = 0; k < (values?.length ?? 0); k++) { const v = Number(values?.[k]); if (v < least) least = v; if (v > most) most = v; }
      if (!(most >= least)) [least, most] = [0, 1];
      this.isSigned = least < 0 && most > 0;
      const size = Math.max(Math.abs(least), Math.abs(most)) || 1;
      if (this.isSigned) [this.low, this.high] = [-roundUp(size), roundUp(size)];
      else if (most <= 0) [this.low, this.high] = [-roundUp(size), 0];
      else [this.low, this.high] = [least > 0.5 * most ? Number(least.toPrecision(3)) : 0, least > 0.5 * most ? Number(most.toPrecision(3)) : roundUp(most)];
      if (!(this.high > this.low)) this.high = this.low + Math.max(1e-9, Math.abs(this.low) * 0.1);
    }
    return low !== this.low || high !== this.high || isSigned !== this.isSigned;
  }

  private ask(): void {
    const { line, path } = this;
    if (path in line.run.signals || this.isAsking || this.rows === line.run.time.length) return;
    this.isAsking = true;
    this.rows = line.run.time.length;
    void this.link.series(line.id, [path], 0, line.end, POINTS).then(series => { this.series = series; this.isAsking = false; this.isNew = true; this.low = NaN; });
  }

  /** Where the value in a row lies on the scale, 0 to 1. */
  part(tracks: Tracks, row: number): number {
    let value: number;
    if (this.path === SPEED) value = tracks.speed[row];
    else if (this.path === TIME) value = tracks.time[row];
    else if (this.path in this.line.run.signals) value = Number(this.line.run.signals[this.path].values[row]);
    else if (this.series && this.series.times.length > 0) {
      const { times, columns } = this.series;
      let low = 0, high = times.length - 1;
      const t = tracks.time[row];
      while (low < high) { const m = (low + high + 1) >> 1; if (times[m] <= t) low = m; else high = m - 1; }
      value = columns[0][low];
    } else value = 0;
    return (value - this.low) / (this.high - this.low);
  }
}
