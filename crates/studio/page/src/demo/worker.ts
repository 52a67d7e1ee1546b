// Runs the studio's module: gives it the project's files in memory, a clock and the browser's WebAssembly for
// plug-ins, and passes on what is said.

import { ConsoleStdout, Directory, File, type Inode, OpenFile, PreopenDirectory, WASI, wasi as filesystem } from '@bjorn3/browser_wasi_shim';
import type { Ask, Told } from './local';
import { modules } from './modules';

/** What the module exports; `crates/demo` says more. */
type Studio = {
  memory: WebAssembly.Memory;
  appell_room(length: number): number; appell_place(): number; appell_length(): number;
  appell_open(): number; appell_hear(): void; appell_turn(): number; appell_next(): number; appell_find(): number;
};

const tell = (told: Told, transfer: Transferable[] = []) => (self as unknown as Worker).postMessage(told, transfer);
const encoder = new TextEncoder(), decoder = new TextDecoder();
const disk = new PreopenDirectory('/', new Map());
let studio: Studio | null = null;
let later: ReturnType<typeof setTimeout> | undefined;

/** A file that tells when it was written: what is put in its place differs. */
class Dated extends File {
  private readonly written = BigInt(Math.round((performance.timeOrigin + performance.now()) * 1e6));
  override stat(): filesystem.Filestat {
    const about = super.stat();
    about.mtim = this.written;
    return about;
  }
}

/** Puts a file into memory, with the folders that lead to it. */
function put(path: string, content: Uint8Array): void {
  const parts = path.split('/');
  let folder = disk.dir.contents;
  for (const part of parts.slice(0, -1)) {
    let next: Inode | undefined = folder.get(part);
    if (!(next instanceof Directory)) { next = new Directory(new Map()); folder.set(part, next); }
    folder = (next as Directory).contents;
  }
  folder.set(parts[parts.length - 1], new Dated(content));
}

function fileAt(path: string): Uint8Array<ArrayBuffer> | null {
  let at: Inode | undefined = disk.dir;
  for (const part of path.split('/').filter(Boolean)) at = at instanceof Directory ? at.contents.get(part) : undefined;
  return at instanceof File ? new Uint8Array(at.data) : null;
}

/** Puts a text where the module looks for it. */
function give(to: Studio, text: string): void {
  const bytes = encoder.encode(text);
  const at = to.appell_room(bytes.length);
  new Uint8Array(to.memory.buffer, at, bytes.length).set(bytes);
}

const left = (of: Studio) => new Uint8Array(of.memory.buffer, of.appell_place(), of.appell_length()).slice();

/** Lets time pass, says what is new, and comes again when there may be more. */
function turn(): void {
  clearTimeout(later);
  if (!studio) return;
  try {
    const rest = studio.appell_turn();
    for (let kind = studio.appell_next(); kind !== 0; kind = studio.appell_next()) {
      const bytes = left(studio);
      if (kind === 1) tell({ text: decoder.decode(bytes) });
      else tell({ frame: bytes.buffer }, [bytes.buffer]);
    }
    later = setTimeout(turn, rest);
  } catch (error) { fail(error); }
}

function fail(error: unknown): void {
  studio = null;
  tell({ failed: `the studio has stopped: ${error instanceof Error ? error.message : error}` });
}

async function open(address: string): Promise<void> {
  const taken = async (path: string) => {
    const answer = await fetch(new URL(path, address));
    if (!answer.ok) throw new Error(`${path}: ${answer.status}`);
    return answer.arrayBuffer();
  };
  // Texts in one file; modules each by itself.
  const project: { texts: Record<string, string>; modules: string[] } = JSON.parse(decoder.decode(await taken('project.json')));
  for (const [path, text] of Object.entries(project.texts)) put(path, encoder.encode(text));
  await Promise.all(project.modules.map(async path => put(path, new Uint8Array(await taken(path)))));
  const log = (line: string) => console.error(line);
  const wasi = new WASI([], [], [new OpenFile(new File([])), ConsoleStdout.lineBuffered(log), ConsoleStdout.lineBuffered(log), disk]);
  const { instance } = await WebAssembly.instantiate(await taken('appell.wasm'), { wasi_snapshot_preview1: wasi.wasiImport, modules: modules(() => module) });
  const module = instance.exports as unknown as Studio;
  wasi.initialize(instance as { exports: { memory: WebAssembly.Memory; _initialize?: () => unknown } });
  const name = new URL(address).searchParams.get('scenario') ?? '';
  give(module, `/scenarios/${name}.toml`);
  if (module.appell_open() !== 0) throw new Error(JSON.parse(decoder.decode(left(module))).problem);
  studio = module;
  tell({ opened: true });
  turn();
}

self.onmessage = ({ data }: MessageEvent<Ask>) => {
  if ('open' in data) { open(data.open).catch(fail); return; }
  if (!studio) return;
  try {
    if ('said' in data) { give(studio, data.said); studio.appell_hear(); turn(); return; }
    // The studio looks for new files by itself.
    if ('put' in data) { put(`scenarios/${data.put}`, data.bytes); return; }
    if (typeof data.asked === 'string') {
      const bytes = fileAt(data.asked);
      tell({ found: data.find, status: bytes ? 200 : 404, bytes: bytes ?? new Uint8Array() });
      return;
    }
    give(studio, JSON.stringify(data.asked));
    const status = studio.appell_find() === 0 ? 200 : 422;
    tell({ found: data.find, status, bytes: left(studio) });
  } catch (error) { fail(error); }
};
