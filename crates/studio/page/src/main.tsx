import { render } from 'preact';
import 'uplot/dist/uPlot.min.css';
import './style.css';
import { App } from './app';
import { palette } from './look';

const style = document.createElement('style');
style.textContent = palette();
document.head.prepend(style);
render(<App />, document.getElementById('app') as HTMLElement);
