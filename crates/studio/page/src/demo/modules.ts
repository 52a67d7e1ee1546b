// Plug-ins that are modules, run by the browser beside the studio. They are sealed off as all WebAssembly is, and
// rewritten by the studio before they come here, so that they count their instructions and keep to their room by
// themselves; `crates/plugin/src/wasm/page.rs` is the other side.

type Instance = { exports: WebAssembly.Exports; memory: WebAssembly.Memory | null; fuel: WebAssembly.Global; functions: Function[] };

/** Functions of mathematics with the bits of the program: what the studio's module exports so, modules import. */
const MATHEMATICS = 'appell_math_';

/** What the studio's module imports to run others; `home` is that module, once it is there. */
export function modules(home: () => { memory: WebAssembly.Memory }): WebAssembly.ModuleImports {
  const instances = new Map<number, Instance>();
  let next = 0, problem = '';
  const bytes = (at: number, length: number) => new Uint8Array(home().memory.buffer, at, length);
  const text = (at: number, length: number) => new TextDecoder().decode(bytes(at, length));
  const of = (instance: number) => instances.get(instance) as Instance;
  const memory = (instance: number) => (of(instance).memory as WebAssembly.Memory).buffer;
  /** Why something failed; the stack is the browser's, and so is what it says of it. */
  const why = (error: unknown) => error instanceof WebAssembly.RuntimeError || error instanceof WebAssembly.CompileError || error instanceof WebAssembly.LinkError ? error.message : 'the browser has no more stack or memory for it';
  return {
    open(at: number, length: number, fuelAt: number, fuelLength: number): number {
      try {
        const env = Object.fromEntries(Object.entries(home()).filter(([name]) => name.startsWith(MATHEMATICS)).map(([name, f]) => [name.slice(MATHEMATICS.length), f as unknown as Function]));
        const { exports } = new WebAssembly.Instance(new WebAssembly.Module(bytes(at, length).slice()), { env });
        const memory = exports.memory instanceof WebAssembly.Memory ? exports.memory : null;
        instances.set(next, { exports, memory, fuel: exports[text(fuelAt, fuelLength)] as WebAssembly.Global, functions: [] });
        return next++;
      } catch (error) { problem = why(error); return -1; }
    },
    close(instance: number): void { instances.delete(instance); },
    function(instance: number, at: number, length: number): number {
      const found = of(instance).exports[text(at, length)];
      return typeof found === 'function' ? of(instance).functions.push(found) - 1 : -1;
    },
    call(instance: number, number: number, at: number, count: number, fuel: bigint, result: number): number {
      const { functions, fuel: tank } = of(instance);
      tank.value = fuel;
      try {
        const given = functions[number](...new Float64Array(home().memory.buffer, at, count));
        new Float64Array(home().memory.buffer, result, 1)[0] = given ?? 0;
        return 1;
      } catch (error) { problem = why(error); return 0; }
    },
    fuel_left: (instance: number): bigint => of(instance).fuel.value,
    size: (instance: number): number => of(instance).memory?.buffer.byteLength ?? -1,
    read(instance: number, from: number, to: number, length: number): void { bytes(to, length).set(new Uint8Array(memory(instance), from, length)); },
    write(instance: number, to: number, from: number, length: number): void { new Uint8Array(memory(instance), to, length).set(bytes(from, length)); },
    told(at: number, length: number): number { return new TextEncoder().encodeInto(problem, bytes(at, length)).written; },
  };
}
