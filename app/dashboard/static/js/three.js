/** The only place that names the file of three.js and with it its version. */
export * from '../vendor/three-0.187.0.js';
