// Reads a recording with Lichtblick's own readers, grammar of message paths, and evaluation of them.
//
//   npm i @mcap/core @lichtblick/rosmsg @lichtblick/rosmsg2-serialization @lichtblick/cdr \
//     @lichtblick/message-definition @foxglove/wasm-lz4 @foxglove/wasm-zstd nearley esbuild lodash-es
//   node .../tests/lichtblick.mjs CHECKOUT_OF_LICHTBLICK msgs_config/layouts/foxglove.json RUN.mcap
//
// Prints a line for each path of the layout. Exit code 1: one has no sense, or a plotted value is no
// number, or a curve goes back in time. Paths without a message are told and are no fault: what a
// recording has depends on the run.
import { execFileSync } from "node:child_process";
import { mkdtempSync, readFileSync } from "node:fs";
import { open } from "node:fs/promises";
import { createRequire } from "node:module";
import { tmpdir } from "node:os";
import { join, resolve } from "node:path";

const require = createRequire(join(process.cwd(), "package.json"));
const [checkout, layout, recording] = process.argv.slice(2).map((path) => resolve(path));

const made = mkdtempSync(join(tmpdir(), "lichtblick-"));
const source = join(checkout, "packages");
const syntax = join(source, "suite-base/src/components/MessagePathSyntax");
const parser = join(source, "message-path/src");
const grammar = {
  name: "nearley",
  setup: (build) =>
    build.onLoad({ filter: /\.ne$/ }, ({ path }) => ({
      contents: execFileSync("npx", ["nearleyc", path], { stdio: ["ignore", "pipe", "ignore"] }),
    })),
};
const types = { "@lichtblick/suite-base/types": join(source, "suite-base/src/types") };
await require("esbuild").build({
  stdin: {
    contents: `export { parseMessagePath } from "${parser}/parseMessagePath";
      export { simpleGetMessagePathDataItems } from "${syntax}/simpleGetMessagePathDataItems";`,
    resolveDir: process.cwd(),
  },
  bundle: true,
  platform: "node",
  outfile: join(made, "lichtblick.cjs"),
  plugins: [grammar],
  alias: { ...types, "@lichtblick/message-path": join(parser, "types.ts") },
  nodePaths: [join(process.cwd(), "node_modules")],
  logLevel: "error",
});
const { parseMessagePath, simpleGetMessagePathDataItems } = require(join(made, "lichtblick.cjs"));
const { McapIndexedReader } = require("@mcap/core");
const { parse } = require("@lichtblick/rosmsg");
const { MessageReader } = require("@lichtblick/rosmsg2-serialization");
const lz4 = require("@foxglove/wasm-lz4");
const zstd = require("@foxglove/wasm-zstd");
await Promise.all([lz4.isLoaded, zstd.isLoaded]);

const paths = Object.entries(JSON.parse(readFileSync(layout, "utf8")).configById).flatMap(
  ([panel, settings]) =>
    [...(settings.paths ?? []).map((p) => p.value), settings.path, settings.topicPath, settings.topicToRender]
      .filter(Boolean)
      .map((path) => ({ panel, path, parsed: parseMessagePath(path), messages: 0, items: 0, numbers: 0, back: 0, last: 0 })),
);
const file = await open(recording);
const size = BigInt((await file.stat()).size);
const read = async (offset, length) =>
  (await file.read(new Uint8Array(Number(length)), 0, Number(length), Number(offset))).buffer;
const reader = await McapIndexedReader.Initialize({
  readable: { size: async () => size, read },
  decompressHandlers: {
    lz4: (bytes, length) => lz4(bytes, Number(length)),
    zstd: (bytes, length) => zstd.decompress(bytes, Number(length)),
  },
});
const readers = new Map();
for await (const raw of reader.readMessages()) {
  const channel = reader.channelsById.get(raw.channelId);
  if (!readers.has(channel.id)) {
    const text = new TextDecoder().decode(reader.schemasById.get(channel.schemaId).data);
    readers.set(channel.id, new MessageReader(parse(text, { ros2: true })));
  }
  const message = readers.get(channel.id).readMessage(raw.data);
  const stamp = message.header?.stamp;
  const time = stamp ? stamp.sec + stamp.nanosec / 1e9 : Number(raw.logTime) / 1e9;
  for (const one of paths.filter((p) => p.parsed?.topicName === channel.topic)) {
    const items = simpleGetMessagePathDataItems({ topic: channel.topic, message }, one.parsed);
    one.messages += 1;
    one.items += items.length;
    one.numbers += items.filter((item) => item !== "" && Number.isFinite(Number(item))).length;
    one.back += time < one.last;
    one.last = time;
  }
}
const plotted = paths.filter((one) => one.panel.startsWith("Plot!"));
for (const one of paths) {
  const told = `${one.messages} messages, ${one.items} values, ${one.numbers} numbers, ${one.back} back in time`;
  console.log(`${one.panel.padEnd(24)} ${one.path.padEnd(62)} ${one.parsed ? told : "makes no sense"}`);
}
const values = plotted.reduce((sum, one) => sum + one.items, 0);
console.log(`${paths.filter((one) => one.parsed).length} of ${paths.length} paths, ${values} values plotted`);
const faulty = paths.some((one) => !one.parsed) || plotted.some((one) => one.numbers < one.items || one.back);
process.exit(faulty ? 1 : 0);
