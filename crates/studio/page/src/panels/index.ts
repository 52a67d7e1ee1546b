// The built-in panels.

import { DEMO } from '../carrier';
import type { OwnModule } from '../panel';
import { arena } from './arena';
import { batch } from './batch';
import { plots } from './plots';
import { plugins } from './plugins';
import { profile } from './profile';
import { table } from './table';

/** Loaded when it is opened first: the library that draws it is larger than the rest of the page. */
const space: OwnModule = { title: '3-D', connect: async host => (await import('./space')).connect(host) };

/** A demo has no folder in which a batch could lie. */
export const BUILT: Record<string, OwnModule> = { arena, space, profile, plots, table, plugins, ...(DEMO ? {} : { batch }) };
