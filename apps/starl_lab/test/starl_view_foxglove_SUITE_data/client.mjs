// The official client: subscribes to all channels and prints what it gets, a line each.
import { createRequire } from 'node:module';
const require = createRequire(process.argv[3] + '/');
const { FoxgloveClient } = require('@foxglove/ws-protocol');
const WebSocket = require('ws');

const client = new FoxgloveClient({
  ws: new WebSocket(process.argv[2], [FoxgloveClient.SUPPORTED_SUBPROTOCOL]),
});
const names = new Map();
const line = (...words) => console.log(JSON.stringify(words));
client.on('serverInfo', (info) => line('info', info.name, info.capabilities));
client.on('status', (status) => line('status', status.message));
client.on('advertise', (channels) => {
  for (const channel of channels) {
    JSON.parse(channel.schema);
    names.set(client.subscribe(channel.id), [channel.topic, channel.schemaName]);
  }
  line('ready');
});
client.on('message', ({ subscriptionId, timestamp, data }) => {
  const [topic, schema] = names.get(subscriptionId);
  line('message', topic, schema, Number(timestamp / 1000n), JSON.parse(new TextDecoder().decode(data)));
});
client.on('time', ({ timestamp }) => line('time', Number(timestamp / 1000n)));
client.on('error', (error) => line('error', String(error)));
client.on('close', () => process.exit(0));
process.stdin.on('end', () => process.exit(0)).resume();
