// How often a signal has each value: a panel of the studio, written against the book's page alone.
//
//   appell studio scenarios/slalom.toml --panels examples/panels
//
// Then open it with the + of any area of the page.

export const title = 'Histogram';
export const settings = { signal: null, bins: 40 };

/** Points for which the studio is asked; more rows are thinned to least and largest values. */
const POINTS = 4000;

export function connect(host) {
  const { signals } = host.scene;
  const known = path => signals.some(signal => signal.path === path);
  const preferred = signals.find(signal => signal.path.endsWith('.twist.forward')) ?? signals[0];
  let chosen = known(host.settings.signal) ? host.settings.signal : preferred.path;

  const bar = document.createElement('div');
  bar.style.cssText = 'position:absolute;left:10px;top:8px;display:flex;gap:8px;align-items:center';
  const select = document.createElement('select');
  select.setAttribute('aria-label', 'signal');
  select.style.cssText = 'font:inherit;max-width:60vw;color:var(--ink);background:var(--panel);border:1px solid var(--line);border-radius:5px;padding:2px 4px';
  select.append(...signals.map(({ path }) => new Option(path.replace(/^robot\./, ''), path, false, path === chosen)));
  const told = document.createElement('span');
  told.style.color = 'var(--ink2)';
  bar.append(select, told);
  const picture = document.createElementNS('http://www.w3.org/2000/svg', 'svg');
  picture.setAttribute('role', 'img');
  host.root.append(picture, bar);

  let last;
  const draw = async frame => {
    last = frame;
    const { times, columns: [values] } = await host.series([chosen], 0, frame.end, POINTS);
    const [width, height] = frame.size;
    const { unit } = signals.find(signal => signal.path === chosen);
    let low = Infinity, high = -Infinity;
    for (const value of values) { low = Math.min(low, value); high = Math.max(high, value); }
    if (!(high > low)) { low -= 0.5; high = low + 1; }
    const { bins } = host.settings;
    const counts = new Array(bins).fill(0);
    for (const value of values) counts[Math.min(bins - 1, Math.floor((value - low) / (high - low) * bins))]++;
    const most = Math.max(1, ...counts);
    const [left, right, top, bottom] = [12, width - 12, 44, height - 26];
    const x = value => left + (value - low) / (high - low) * (right - left);
    const now = frame.values[chosen];
    picture.setAttribute('width', width);
    picture.setAttribute('height', height);
    picture.setAttribute('aria-label', `Histogram of ${chosen}`);
    picture.innerHTML = counts.map((count, k) => {
      const tall = (bottom - top) * count / most;
      return `<rect x="${left + k * (right - left) / bins}" y="${bottom - tall}" width="${Math.max(1, (right - left) / bins - 1)}" height="${tall}" fill="var(--blue)"/>`;
    }).join('') + `<path d="M${left} ${bottom}H${right}" stroke="var(--ink2)"/>` +
      (now >= low && now <= high ? `<path d="M${x(now)} ${top}V${bottom}" stroke="var(--vermilion)" stroke-width="1.5"/>` : '') +
      [[low, 'start'], [high, 'end']].map(([value, anchor]) => `<text x="${x(value)}" y="${height - 8}" text-anchor="${anchor}" fill="var(--ink2)" font-size="12">${value.toPrecision(3)}${unit === '1' ? '' : ` ${unit}`}</text>`).join('');
    told.textContent = `${times.length} values${Number.isFinite(now) ? `, now ${now.toPrecision(3)}` : ''}`;
  };

  select.onchange = () => {
    chosen = select.value;
    host.keep({ signal: chosen });
    host.watch([chosen]);
    void draw(last);
  };
  host.watch([chosen]);
  return { draw };
}
