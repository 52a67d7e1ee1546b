// What a panel is: a module that connects to a host, and draws when there is something new. Built-in panels and
// those of a project are written against the same; the book has it in words.

import type { ComponentType } from 'preact';
import { Component, createElement, render, type ComponentChildren } from 'preact';
import type { Robot, Run } from '../../../sim/web/run.js';
import type { Series } from './net';
import type { Studio } from './studio';

/** Of what a panel draws. */
export type PanelScene = { name: string; title: string; signals: { path: string; unit: string }[]; robots: Robot[]; arena: Run['arena']; period: number };
/** How it is to look: the palette by the names of `LOOK`. */
export type Look = { theme: 'light' | 'dark'; language: string; colors: Record<string, string> };
/** An instant: the time looked at and the newest one, s, and the values there of the signals that are watched. */
export type Frame = { time: number; end: number; playing: boolean; line: number; values: Record<string, number> };
/** What a panel has of the page. */
export interface Host {
  readonly root: HTMLElement;
  readonly scene: PanelScene;
  readonly look: Look;
  readonly settings: Record<string, unknown>;
  /** Remembers settings of this panel. */
  keep(changed: Record<string, unknown>): void;
  /** From now on frames have the values of these signals. */
  watch(paths: Iterable<string>): void;
  /** Signals between two times, s, thinned to least and largest values for so many points. */
  series(paths: Iterable<string>, from: number, to: number, points: number): Promise<Series>;
  /** Looks at another instant. */
  seek(time: number): void;
}
export interface Panel {
  draw(frame: Frame): unknown;
  disconnect?(): void;
}
export interface PanelModule<H extends Host = Host> {
  title: string;
  settings?: Record<string, unknown>;
  connect(host: H): Panel | Promise<Panel>;
}

/** What built-in panels have beyond it: all that the page knows, and its hands. */
export interface OwnHost extends Host {
  studio(): Studio;
  /** Closes the panel with a message. */
  fail(error: unknown): void;
}
export type OwnModule = PanelModule<OwnHost>;

/** Tells the host of what goes wrong in components. */
class Guard extends Component<{ fail: (error: unknown) => void; children?: ComponentChildren }, { failed: boolean }> {
  state = { failed: false };
  componentDidCatch(error: unknown): void {
    this.setState({ failed: true });
    this.props.fail(error);
  }
  render() { return this.state.failed ? null : this.props.children; }
}

export type ViewProps = { host: OwnHost; studio: Studio; frame: Frame };

/** A panel whose drawing is a component. */
export function componentPanel(title: string, view: ComponentType<ViewProps>, settings?: Record<string, unknown>): OwnModule {
  return {
    title, settings,
    connect: host => ({
      draw: frame => render(createElement(Guard, { fail: host.fail }, createElement(view, { host, studio: host.studio(), frame })), host.root),
      disconnect: () => render(null, host.root),
    }),
  };
}

/** Calls a function at each picture of the screen, until it is stopped; what it throws closes the panel. */
export function eachPicture(fail: (error: unknown) => void, picture: (now: number) => void): () => void {
  let handle = requestAnimationFrame(function next(now) {
    handle = requestAnimationFrame(next);
    try { picture(now); } catch (error) { cancelAnimationFrame(handle); fail(error); }
  });
  return () => cancelAnimationFrame(handle);
}
