%% What a robot hears of the port program in its tests.
-define(STOP, <<145, 0, 0, 0, 0>>).
%% Zeros fill the rest of a command that was begun.
-define(STOPS, <<0:32, ?STOP/binary, 0:320, ?STOP/binary>>).
-define(STOPS_SIZE, 54).
-define(GO, <<145, 0, 100, 0, 100>>).
-define(LONG_US, 600000000).
%% A guard against waiting for ever.
-define(AFTER_MS, 20000).
