// What carries words between the page and the studio: a socket to a server; or, where the page is a demo and all
// of the studio is beside it, a worker that is spoken to in the same words.

/** What is common to the two. */
export interface Carrier {
  onopen: (() => void) | null;
  onclose: (() => void) | null;
  onmessage: ((event: { data: unknown }) => void) | null;
  send(text: string): void;
  /** Lays a file beside the scenarios, where the studio has no disk of its own. */
  put?(file: File): Promise<void>;
  /** Why it carries no more, where it knows. */
  problem?: string;
}

/** Whether the studio is in the page: set when it is built. */
export const DEMO = import.meta.env.MODE === 'demo';

const worker = import.meta.env.MODE === 'demo' ? import('./demo/local').then(({ Local }) => new Local()) : null;

export async function connect(): Promise<Carrier> {
  if (worker) return worker;
  const socket = new WebSocket(new URL('socket', location.href).href.replace(/^http/, 'ws'));
  socket.binaryType = 'arraybuffer';
  return socket as Carrier;
}

/** Lays a file beside the scenarios of the page. */
export async function put(file: File): Promise<void> {
  await (await worker)?.put?.(file);
}

/** What lies at an address below the page's own, such as `api/crossing?height=0.2`. */
export async function find(address: string): Promise<Response> {
  return worker ? (await worker).find(address) : fetch(address);
}
