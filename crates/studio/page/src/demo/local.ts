// The studio beside the page, in a worker, with the manners of a socket.

import type { Carrier } from '../carrier';

/** To the worker. */
export type Ask = { said: string } | { find: number; asked: object | string } | { open: string } | { put: string; bytes: Uint8Array<ArrayBuffer> };
/** From it: what a socket would carry, and what was found. */
export type Told = { text: string } | { frame: ArrayBuffer } | { opened: true } | { failed: string } | { found: number; status: number; bytes: Uint8Array<ArrayBuffer> };

export class Local implements Carrier {
  onopen: (() => void) | null = null;
  onclose: (() => void) | null = null;
  onmessage: ((event: { data: unknown }) => void) | null = null;
  problem?: string;
  private readonly worker = new Worker(new URL('./worker.ts', import.meta.url), { type: 'module' });
  private readonly asked = new Map<number, (found: Response) => void>();
  private next = 1;

  constructor() {
    this.worker.onmessage = (event: MessageEvent<Told>) => this.hear(event.data);
    this.worker.onerror = event => this.fail(event.message);
    // What the address names, as in `?scenario=gate`.
    const name = new URLSearchParams(location.search).get('scenario') ?? 'slalom';
    this.ask({ open: new URL(`?scenario=${encodeURIComponent(name)}`, location.href).href });
  }

  private ask(ask: Ask): void { this.worker.postMessage(ask); }

  private hear(told: Told): void {
    if ('text' in told) this.onmessage?.({ data: told.text });
    else if ('frame' in told) this.onmessage?.({ data: told.frame });
    else if ('opened' in told) this.onopen?.();
    else if ('failed' in told) this.fail(told.failed);
    else {
      this.asked.get(told.found)?.(new Response(told.bytes, { status: told.status }));
      this.asked.delete(told.found);
    }
  }

  private fail(problem: string): void {
    this.problem = problem;
    this.onclose?.();
  }

  send(text: string): void { this.ask({ said: text }); }

  async put(file: File): Promise<void> { this.ask({ put: file.name, bytes: new Uint8Array(await file.arrayBuffer()) }); }

  find(address: string): Promise<Response> {
    const url = new URL(address, location.href);
    const number = this.next++;
    const recording = address.match(/^api\/lines\/(\d+)\/recording\.(\w+)$/);
    const lengths = Object.fromEntries([...url.searchParams].map(([name, value]) => [name, Number(value)]));
    const asked = recording ? { recording: { line: Number(recording[1]), format: recording[2] } } : address.startsWith('api/crossing') ? { crossing: lengths } : address;
    return new Promise(done => { this.asked.set(number, done); this.ask({ find: number, asked }); });
  }
}
