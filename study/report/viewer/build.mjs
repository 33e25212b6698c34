// Bundles source/ and what it uses of ogl into bundle.js. Run by `make viewer`.
import { createHash } from 'node:crypto';
import { readdirSync, readFileSync } from 'node:fs';
import { build } from 'esbuild';

const files = ['package.json', ...readdirSync('source').sort().map((name) => `source/${name}`)];
const hash = createHash('sha256');
for (const file of files) hash.update(`${file}\n${readFileSync(file, 'utf8')}`);

await build({
  entryPoints: ['source/main.js'],
  outfile: 'bundle.js',
  bundle: true,
  minify: true,
  format: 'iife',
  target: 'es2020',
  charset: 'utf8',
  legalComments: 'none',
  banner: { js: `/* sources ${hash.digest('hex')}; with ogl 1.0.11, see LICENSE-ogl */` },
});
