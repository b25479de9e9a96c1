/** The only place that names the file of uPlot and with it its version. */
export { default } from '../vendor/uplot-1.6.32.js';
