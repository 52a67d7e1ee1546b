// What a page remembers: how one likes it, never what runs.

export function remembered<T>(key: string, otherwise: T): T {
  try { const text = localStorage.getItem('appell.' + key); return text === null ? otherwise : JSON.parse(text); } catch { return otherwise; }
}

export function remember(key: string, value: unknown): void {
  try { localStorage.setItem('appell.' + key, JSON.stringify(value)); } catch { /* a page without storage forgets */ }
}
