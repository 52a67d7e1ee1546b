// The look, from the palette that all pictures share.

import { DARK, FONT, LIGHT, pictureStyle } from '../../../sim/web/draw.js';

export type Theme = 'light' | 'dark';

/** Style sheet of the pictures, and the palette as custom properties. */
export function palette(): string {
  const vars = (colors: Record<string, string>) => Object.entries(colors).map(([name, value]) => `--${name}:${value}`).join(';');
  return `:root{--font:${FONT};${vars(LIGHT)}}[data-theme=dark]{${vars(DARK)};color-scheme:dark}${pictureStyle(name => `var(--${name})`)}`;
}

export function color(name: string): string {
  return getComputedStyle(document.documentElement).getPropertyValue('--' + name).trim();
}

const UNITS: Record<string, [string, number?]> = {
  speed: ['m/s'], acceleration: ['m/s²'], lateral_acceleration: ['m/s²'], yaw_rate: ['rad/s'], yaw_acceleration: ['rad/s²'], lookahead: ['m'],
  mass: ['kg'], inertia_com: ['kg·m²'], radius: ['m'], width: ['m'], friction: ['1'], resistance: ['Ω'], inductance: ['H'], torque_constant: ['N·m/A'],
  voltage_max: ['V'], current_max: ['A'], gear_ratio: ['1'], gear_efficiency: ['1'], slope_deg: ['°'], downhill_heading_deg: ['°'], gravity: ['m/s²'],
  spin_inertia: ['kg·m²'], vertical_inertia: ['kg·m²'], rotor_inertia: ['kg·m²'], trail: ['m'], torque_max: ['N·m'],
};

export function unitOf(path: string): string {
  const parts = path.split('.');
  const last = parts[parts.length - 1];
  if (/^\d+$/.test(last) && ['center_of_mass', 'mount'].includes(parts[parts.length - 2])) return 'm';
  return UNITS[last]?.[0] ?? '';
}

/** The range that a slider of a number has: round numbers about its first value. */
export function rangeOf(path: string, first: number): [number, number, number] {
  const last = path.split('.').pop() ?? '';
  if (['friction'].includes(last)) return [0.05, 1.5, 0.01];
  if (last === 'gear_efficiency') return [0.1, 1, 0.01];
  if (last === 'slope_deg') return [-20, 20, 0.1];
  if (last.endsWith('heading_deg')) return [-180, 180, 1];
  const size = Math.abs(first) > 0 ? Math.abs(first) : 1;
  const power = Math.pow(10, Math.floor(Math.log10(size * 3)));
  const top = [1, 1.5, 2, 3, 4, 5, 8, 10].map(m => m * power).find(v => v >= size * 2.4) ?? size * 3;
  const step = Math.pow(10, Math.floor(Math.log10(top)) - 2);
  return first > 0 ? [Math.max(step, Number((size / 8).toPrecision(1))), top, step] : [-top, top, step];
}
