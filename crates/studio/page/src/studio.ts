// What built-in panels see of the page, and what they can do.

import type { Line, LineState, Link, PlotSpec, RobotState, State } from './net';
import type { Theme } from './look';

export type Follow = 'fit' | 'follow' | 'free';
/** A line that is shown beside the one looked at. */
export type Other = { about: LineState; line: Line; color: string; dash: boolean };

export interface Studio {
  link: Link;
  state: State;
  line: Line;
  about: LineState;
  others: Other[];
  /** The time that is looked at, s. */
  time: () => number;
  seek: (t: number | null) => void;
  run: (command: Record<string, unknown>) => Promise<unknown>;
  /** Like `run`; of those that wait only the newest is done. */
  stream: (command: Record<string, unknown>) => void;
  at: () => number | undefined;
  follow: Follow;
  setFollow: (follow: Follow) => void;
  measuring: boolean;
  setMeasuring: (on: boolean) => void;
  forces: boolean;
  setForces: (on: boolean) => void;
  placing: boolean;
  setPlacing: (on: boolean) => void;
  hand: RobotState | null;
  specs: PlotSpec[];
  setSpecs: (specs: PlotSpec[] | null) => void;
  span: [number, number] | null;
  setSpan: (span: [number, number] | null) => void;
  theme: Theme;
  /** Events that have numbers. */
  events: { n: number; t: number }[];
  open: (panel: string) => void;
}
