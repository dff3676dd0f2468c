// Reads a recording by @mcap/core, as Foxglove does: by its index, every checksum looked at.
// Prints of each topic how many messages it has and the SHA-256 over their bytes, as JSON.
const { createHash } = require("node:crypto");
const { open } = require("node:fs/promises");
const { McapIndexedReader } = require("@mcap/core");
const { decompress } = require("fzstd");

async function main(path) {
  const file = await open(path);
  const readable = {
    size: async () => BigInt((await file.stat()).size),
    read: async (offset, length) => {
      const bytes = new Uint8Array(Number(length));
      await file.read(bytes, 0, bytes.length, Number(offset));
      return bytes;
    },
  };
  const reader = await McapIndexedReader.Initialize({
    readable,
    decompressHandlers: { zstd: (bytes, size) => decompress(bytes, new Uint8Array(Number(size))) },
  });
  const topics = new Map();
  for await (const message of reader.readMessages()) {
    const topic = reader.channelsById.get(message.channelId).topic;
    const of = topics.get(topic) ?? { count: 0, hash: createHash("sha256") };
    of.count += 1;
    of.hash.update(message.data);
    topics.set(topic, of);
  }
  const found = [...topics].map(([topic, of]) => [topic, [of.count, of.hash.digest("hex")]]);
  console.log(JSON.stringify(Object.fromEntries(found)));
  await file.close();
}

main(process.argv[2]);
