// Reads recordings with the Go library of the makers of MCAP: record by record with all checksums,
// and by the index. Says what does not agree, and counts the messages of each topic.
package main

import (
	"bytes"
	"encoding/binary"
	"encoding/json"
	"errors"
	"fmt"
	"hash/crc32"
	"io"
	"os"
	"sort"

	"github.com/foxglove/mcap/go/mcap"
)

// What a way of reading finds in a file.
type found struct {
	topics map[string]uint64
	last   uint64
	count  uint64
}

func (f *found) add(schema *mcap.Schema, channel *mcap.Channel, message *mcap.Message) error {
	if schema == nil || schema.Encoding != "jsonschema" || channel.MessageEncoding != "json" {
		return fmt.Errorf("%s is not JSON with a schema", channel.Topic)
	}
	if !json.Valid(message.Data) || !json.Valid(schema.Data) {
		return fmt.Errorf("%s at %d: not JSON", channel.Topic, message.LogTime)
	}
	if message.LogTime < f.last {
		return fmt.Errorf("%s at %d: after %d", channel.Topic, message.LogTime, f.last)
	}
	f.topics[channel.Topic+" "+schema.Name]++
	f.last = message.LogTime
	f.count++
	return nil
}

// Record by record; the lexer checks the sums of chunks and attachments.
func lexed(file []byte) (*found, error) {
	lexer, err := mcap.NewLexer(bytes.NewReader(file), &mcap.LexerOptions{
		ValidateChunkCRCs:     true,
		ComputeAttachmentCRCs: true,
		AttachmentCallback:    attached,
	})
	if err != nil {
		return nil, err
	}
	defer lexer.Close()
	f := &found{topics: map[string]uint64{}}
	schemas := map[uint16]*mcap.Schema{}
	channels := map[uint16]*mcap.Channel{}
	for {
		token, record, err := lexer.Next(nil)
		if errors.Is(err, io.EOF) || token == mcap.TokenFooter {
			return f, nil
		}
		if err != nil {
			return nil, err
		}
		switch token {
		case mcap.TokenSchema:
			schema, err := mcap.ParseSchema(record)
			if err != nil {
				return nil, err
			}
			schemas[schema.ID] = schema
		case mcap.TokenChannel:
			channel, err := mcap.ParseChannel(record)
			if err != nil {
				return nil, err
			}
			if schemas[channel.SchemaID] == nil {
				return nil, fmt.Errorf("%s comes before its schema", channel.Topic)
			}
			channels[channel.ID] = channel
		case mcap.TokenMessage:
			message, err := mcap.ParseMessage(record)
			if err != nil {
				return nil, err
			}
			channel := channels[message.ChannelID]
			if channel == nil {
				return nil, fmt.Errorf("a message comes before its channel %d", message.ChannelID)
			}
			if err := f.add(schemas[channel.SchemaID], channel, message); err != nil {
				return nil, err
			}
		}
	}
}

func attached(reader *mcap.AttachmentReader) error {
	if _, err := io.Copy(io.Discard, reader.Data()); err != nil {
		return err
	}
	computed, err := reader.ComputedCRC()
	if err != nil {
		return err
	}
	parsed, err := reader.ParsedCRC()
	if err == nil && computed != parsed {
		err = fmt.Errorf("the checksum of attachment %s is wrong", reader.Name)
	}
	return err
}

// By the reader, with or without the index.
func read(file []byte, byIndex bool) (*found, error) {
	reader, err := mcap.NewReader(bytes.NewReader(file))
	if err != nil {
		return nil, err
	}
	defer reader.Close()
	messages, err := reader.Messages(mcap.UsingIndex(byIndex))
	if err != nil {
		return nil, err
	}
	f := &found{topics: map[string]uint64{}}
	for {
		schema, channel, message, err := messages.NextInto(nil)
		if errors.Is(err, io.EOF) {
			return f, nil
		}
		if err != nil {
			return nil, err
		}
		if err := f.add(schema, channel, message); err != nil {
			return nil, err
		}
	}
}

// The statistics and the indexes say what is there.
func summed(file []byte, f *found) error {
	reader, err := mcap.NewReader(bytes.NewReader(file))
	if err != nil {
		return err
	}
	defer reader.Close()
	info, err := reader.Info()
	if err != nil {
		return err
	}
	statistics := info.Statistics
	if statistics == nil || statistics.MessageCount != f.count {
		return errors.New("the statistics count other messages")
	}
	if int(statistics.ChunkCount) != len(info.ChunkIndexes) || statistics.MessageEndTime != f.last {
		return errors.New("the statistics and the index do not agree")
	}
	for id, channel := range info.Channels {
		topic := channel.Topic + " " + info.Schemas[channel.SchemaID].Name
		if statistics.ChannelMessageCounts[id] != f.topics[topic] {
			return fmt.Errorf("the statistics count other messages of %s", topic)
		}
	}
	return nil
}

// The checksums of the data section and of the summary, which the library leaves to its users.
func checked(file []byte) error {
	footer := file[len(file)-8-20:]
	summary := binary.LittleEndian.Uint64(footer)
	if summary == 0 {
		return errors.New("there is no summary")
	}
	dataEnd := file[summary-13 : summary]
	if dataEnd[0] != byte(mcap.OpDataEnd) {
		return errors.New("there is no end of the data before the summary")
	}
	if crc32.ChecksumIEEE(file[:summary-13]) != binary.LittleEndian.Uint32(dataEnd[9:]) {
		return errors.New("the checksum of the data is wrong")
	}
	end := len(file) - 8 - 4
	if crc32.ChecksumIEEE(file[summary:end]) != binary.LittleEndian.Uint32(file[end:]) {
		return errors.New("the checksum of the summary is wrong")
	}
	return nil
}

func same(a, b *found) bool {
	if a.count != b.count || a.last != b.last || len(a.topics) != len(b.topics) {
		return false
	}
	for topic, n := range a.topics {
		if b.topics[topic] != n {
			return false
		}
	}
	return true
}

func whole(file []byte) (*found, error) {
	f, err := lexed(file)
	if err != nil {
		return nil, err
	}
	for _, byIndex := range []bool{true, false} {
		other, err := read(file, byIndex)
		if err != nil {
			return nil, err
		}
		if !same(f, other) {
			return nil, fmt.Errorf("other messages are read, by index %t", byIndex)
		}
	}
	if err := summed(file, f); err != nil {
		return nil, err
	}
	return f, checked(file)
}

func main() {
	for _, name := range os.Args[1:] {
		file, err := os.ReadFile(name)
		if err == nil {
			var f *found
			if f, err = whole(file); err == nil {
				f.print(name)
				continue
			}
		}
		fmt.Printf("%s: %s\n", name, err)
		os.Exit(1)
	}
}

func (f *found) print(name string) {
	var topics []string
	for topic := range f.topics {
		topics = append(topics, topic)
	}
	sort.Strings(topics)
	fmt.Println(name)
	for _, topic := range topics {
		fmt.Println(topic, f.topics[topic])
	}
	fmt.Println("end", f.last)
}
