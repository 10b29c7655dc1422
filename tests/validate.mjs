// Runs the Khronos validator over outputs and their sources: an output may have no kind of error or warning that its
// source does not have, and none at an object of the source that was fine before.
//
//     node tests/validate.mjs SOURCES OUTPUTS
//
// Installs the validator into target/validator first. Outputs that are missing are listed, not judged: the tool has its
// own exit code for inputs that it cannot process.

import { execFileSync } from "node:child_process";
import { existsSync, mkdirSync, readdirSync, readFileSync } from "node:fs";
import { createRequire } from "node:module";
import { dirname, join, relative, resolve } from "node:path";
import { fileURLToPath } from "node:url";

const VALIDATOR = "gltf-validator@2.0.0-dev.3.10";
const WORST_TWO = 2; // severities 0 (error) and 1 (warning)

const home = resolve(dirname(fileURLToPath(import.meta.url)), "../target/validator");

function loadValidator() {
  if (!existsSync(join(home, "node_modules/gltf-validator"))) {
    mkdirSync(home, { recursive: true });
    execFileSync("npm", ["install", "--no-save", "--no-audit", "--no-fund", "--silent", "--prefix", home, VALIDATOR], {
      stdio: "inherit",
    });
  }
  return createRequire(join(home, "anchor.js"))("gltf-validator");
}

function assetsBelow(directory) {
  const entries = readdirSync(directory, { recursive: true, withFileTypes: true });
  const files = entries.filter((entry) => entry.isFile() && /\.(glb|gltf)$/i.test(entry.name));
  return files.map((entry) => relative(directory, join(entry.parentPath ?? entry.path, entry.name))).sort();
}

async function issuesOf(validator, file) {
  const report = await validator.validateBytes(new Uint8Array(readFileSync(file)), {
    uri: file,
    maxIssues: 0,
    externalResourceFunction: async (uri) => new Uint8Array(readFileSync(join(dirname(file), decodeURIComponent(uri)))),
  });
  return report.issues.messages.filter((issue) => issue.severity < WORST_TWO);
}

/** Issues of the output that are new in kind, or new at an object that the source has too. */
function findNewIssues(before, after, source) {
  const codes = new Set(before.map((issue) => issue.code));
  const places = new Set(before.map((issue) => `${issue.code} ${issue.pointer}`));
  return after.filter(
    (issue) => !codes.has(issue.code) || (existsAt(source, issue.pointer) && !places.has(`${issue.code} ${issue.pointer}`)),
  );
}

function existsAt(document, pointer = "") {
  let at = document;
  for (const key of pointer.split("/").slice(1)) {
    at = at?.[key.replaceAll("~1", "/").replaceAll("~0", "~")];
  }
  return at !== undefined;
}

function readDocument(file) {
  const bytes = readFileSync(file);
  const isBinary = bytes.subarray(0, 4).toString() === "glTF";
  return JSON.parse(isBinary ? bytes.subarray(20, 20 + bytes.readUInt32LE(12)) : bytes);
}

const [sources, outputs] = process.argv.slice(2);
if (outputs === undefined) {
  console.error("usage: node tests/validate.mjs SOURCES OUTPUTS");
  process.exit(2);
}
const validator = loadValidator();
let [judged, missing, worse] = [0, 0, 0];
for (const name of assetsBelow(sources)) {
  const source = join(sources, name);
  // Progressive files are GLBs whatever their source is.
  const output = [name, name.replace(/\.gltf$/i, ".glb")].map((file) => join(outputs, file)).find(existsSync);
  if (output === undefined) {
    console.log(`${name}: no output`);
    missing += 1;
    continue;
  }
  const before = await issuesOf(validator, source);
  const fresh = findNewIssues(before, await issuesOf(validator, output), readDocument(source));
  for (const issue of fresh.slice(0, 10)) {
    console.error(`${name}: ${issue.pointer ?? ""}: ${issue.code}: ${issue.message}`);
  }
  judged += 1;
  worse += fresh.length > 0 ? 1 : 0;
}
console.log(`${judged} outputs validated, ${missing} missing, ${worse} with new errors or warnings`);
process.exit(worse > 0 || judged === 0 ? 1 : 0);
