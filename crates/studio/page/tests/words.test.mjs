// Every word that the page takes from its catalogue is in it, in every language, and no other is.

import assert from 'node:assert/strict';
import { readdirSync, readFileSync } from 'node:fs';
import { join } from 'node:path';
import { test } from 'node:test';

const src = join(import.meta.dirname, '../src');
const files = readdirSync(src, { recursive: true }).filter(name => /\.tsx?$/.test(name) && name !== 'words.ts');
const texts = files.map(name => readFileSync(join(src, name), 'utf8'));
const catalogue = Object.fromEntries([...readFileSync(join(src, 'words.ts'), 'utf8').matchAll(/^ {2}'([^']+)': (\[.*\]),$/gm)].map(([, key, row]) => [key, row.slice(2, -2).split("', '")]));
const asked = new Set(texts.flatMap(text => [...text.matchAll(/\btr\('([^']+)'\)/g)].map(([, key]) => key)));

test('every word has its translations', () => {
  assert.deepEqual([...asked].filter(key => !(key in catalogue)), []);
  for (const [key, row] of Object.entries(catalogue)) {
    assert.equal(row.length, 3, key);
    assert.ok(row.every(word => word.trim().length > 0), key);
    assert.match(row[0], /[\u0400-\u04ff]|^3D$/, `Russian of ${key}`);
    assert.match(row[1], /[\u4e00-\u9fff]/, `Chinese of ${key}`);
  }
});

test('no translation is left over', () => {
  // Others are asked for by what they name: titles of panels and plots, keys, verdicts.
  const quoted = key => texts.some(text => text.includes(`'${key}'`)) || ['speed', 'motor voltage', 'wheel torque', 'friction used', 'clearance', 'passed', 'failed', 'stopped'].includes(key);
  assert.deepEqual(Object.keys(catalogue).filter(key => !asked.has(key) && !quoted(key)), []);
});
