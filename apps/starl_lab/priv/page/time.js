// Times for people: those of a run in seconds; those of robots on their own, which count from 1970, of the day.
const SINCE_1970 = 1e14;

export const seconds = us => us < SINCE_1970 ? `${(us / 1e6).toFixed(3)} s`
  : `${new Date(us / 1000).toISOString().slice(0, 23).replace('T', ' ')} UTC`;
